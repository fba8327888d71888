#include "tiling/adjust/live_adjust.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "tests/unit/adjust/textured_ground.h"
#include "tiling/adjust/lens_profile.h"

namespace overfly::tiling::adjust {
namespace {

using tests::TexturedGround;

constexpr std::int64_t kSecond = 1'000'000'000;

struct Flown {
  std::vector<LiveFrame> handed;
  std::map<FrameId, capture::Pose> last;  // as handed on last
  LiveAdjuster::Status status;
};

// One frame every two seconds, which take no time to adjust.
Flown fly(TexturedGround& ground, LiveAdjuster& adjuster, int frames, double noise_m, double noise_rad) {
  Flown out;
  const auto take = [&](const std::vector<LiveFrame>& ready) {
    for (const LiveFrame& frame : ready) {
      out.handed.push_back(frame);
      out.last[frame.id] = frame.pose;
    }
  };
  for (int i = 0; i < frames; ++i) {
    const std::int64_t now = 2 * kSecond * i;
    take(adjuster.add(static_cast<FrameId>(i), *ground.frame(i, noise_m, noise_rad), nullptr, now, now));
    take(adjuster.wait(now + kSecond));
  }
  take(adjuster.land());
  out.status = adjuster.status();
  return out;
}

LiveAdjustOptions quick() {
  LiveAdjustOptions options;
  options.adjuster.features.long_side_px = 480;
  options.adjuster.features.most = 600;
  return options;
}

TEST(LiveAdjust, EveryFrameIsHandedOnOnceAtFirstAndEndsNearTheTruth) {
  TexturedGround ground;
  LiveAdjuster adjuster(quick());
  const Flown flown = fly(ground, adjuster, 20, 0.5, 0.02);
  std::map<FrameId, int> firsts;
  for (const LiveFrame& frame : flown.handed) {
    if (!frame.again) ++firsts[frame.id];
    EXPECT_TRUE(frame.again || firsts[frame.id] == 1) << frame.id;
    EXPECT_GE(firsts[frame.id], 1) << "again before the first time: " << frame.id;
  }
  EXPECT_EQ(firsts.size(), 20U);
  EXPECT_EQ(flown.status.adjusted, 20U);
  EXPECT_TRUE(flown.status.held_back.empty());
  for (const auto& [id, pose] : flown.last)
    EXPECT_LT((ground.positionOf(pose) - TexturedGround::at(static_cast<int>(id)).position).norm(), 1.0)
        << id;
}

TEST(LiveAdjust, AFrameWaitsNoLongerThanItIsTold) {
  TexturedGround ground;
  LiveAdjustOptions options = quick();
  options.max_wait_s = 5;
  LiveAdjuster adjuster(options);
  std::map<FrameId, std::int64_t> waited;
  for (int i = 0; i < 12; ++i) {
    const std::int64_t arrived = 2 * kSecond * i;
    for (const std::int64_t now : {arrived, arrived + kSecond}) {
      auto ready = now == arrived ? adjuster.add(static_cast<FrameId>(i), *ground.frame(i, 0.5, 0.02),
                                                 nullptr, arrived, now)
                                  : adjuster.wait(now);
      for (const LiveFrame& frame : ready)
        if (!frame.again) waited[frame.id] = now - frame.since_ns;
    }
  }
  EXPECT_EQ(waited.size(), 10U);  // the last two still wait
  for (const auto& [id, time] : waited) EXPECT_LE(time, 5 * kSecond) << id;
}

TEST(LiveAdjust, FramesOfWaterAreHeldBackWithTheReasonAndTheOthersAreMapped) {
  TexturedGround ground;
  LiveAdjuster adjuster(quick());
  std::uint64_t handed = 0;
  for (int i = 0; i < 12; ++i) {
    const std::int64_t now = 2 * kSecond * i;
    ground.featureless = i == 5 || i == 6;
    for (const auto& ready :
         {adjuster.add(static_cast<FrameId>(i), *ground.frame(i, 0.5, 0.02), nullptr, now, now),
          adjuster.wait(now + kSecond)})
      for (const LiveFrame& frame : ready) {
        handed += frame.again ? 0 : 1;
        EXPECT_NE(frame.id, 5U);
        EXPECT_NE(frame.id, 6U);
      }
  }
  for (const LiveFrame& frame : adjuster.land()) handed += frame.again ? 0 : 1;
  EXPECT_EQ(handed, 10U);
  const auto status = adjuster.status();
  ASSERT_EQ(status.held_back.size(), 1U);
  EXPECT_EQ(status.held_back.begin()->first, "no overlap");
  EXPECT_EQ(status.held_back.begin()->second, 2U);
}

// Where the pictures do not say it, nothing wrong may be said: frames are refused, or right within their
// stated uncertainty.
void expectHonest(TexturedGround& ground, int frames) {
  AdjusterOptions options;
  options.features.long_side_px = 480;
  options.features.most = 600;
  Adjuster adjuster(ground.camera, options);
  for (int i = 0; i < frames; ++i) {
    const auto frame = ground.frame(i, 0.5, 0.02);
    const auto& image = frame->image;
    ASSERT_TRUE(adjuster.addFrame(static_cast<FrameId>(i),
                                  {image.bytes.data(), image.width, image.height, image.stride},
                                  *frame->pose));
  }
  for (const AdjustedPose& pose : adjuster.adjustAll()) {
    if (pose.state != FrameState::Adjusted) {
      EXPECT_FALSE(pose.reason.empty()) << pose.id;
      continue;
    }
    const Eigen::Vector3d off =
        ground.positionOf(pose.pose) - TexturedGround::at(static_cast<int>(pose.id)).position;
    for (int k = 0; k < 3; ++k)
      EXPECT_LT(std::abs(off[k]), 3.5 * std::sqrt(pose.pose.covariance(k, k))) << pose.id << " axis " << k;
  }
}

TEST(LiveAdjust, RowsOfAFieldAreRefusedOrRight) {
  TexturedGround ground;
  ground.rows = true;
  expectHonest(ground, 10);
}

TEST(LiveAdjust, ARepeatedFacadeIsRefusedOrRight) {
  for (const double period : {3.0, 8.0}) {  // the second is the way between two frames
    TexturedGround ground;
    ground.repeats_m = period;
    expectHonest(ground, 10);
  }
}

TEST(LiveAdjust, RevisionsComeInBatchesAndOnlyForFramesThatMoved) {
  TexturedGround ground;
  LiveAdjustOptions options = quick();
  options.max_wait_s = 3;  // handed on early, with poses that move later
  options.adjuster.map.revise_px = 0.5;
  LiveAdjuster adjuster(options);
  const Flown flown = fly(ground, adjuster, 20, 1, 0.03);
  EXPECT_GT(flown.status.revised, 0U);
  EXPECT_LT(flown.status.batches, 8U);
  std::uint64_t again = 0;
  std::map<FrameId, capture::Pose> before;
  for (const LiveFrame& frame : flown.handed) {
    if (frame.again) {
      ++again;
      EXPECT_GT((frame.pose.position_in_ecef - before.at(frame.id).position_in_ecef).norm() +
                    20 * frame.pose.ecef_from_camera.angularDistance(before.at(frame.id).ecef_from_camera),
                0.002);
    }
    before[frame.id] = frame.pose;
  }
  EXPECT_EQ(again, flown.status.revised);
}

TEST(LiveAdjust, TheNextFlightStartsFromTheCalibratedLens) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "profiles";
  std::filesystem::create_directories(folder);
  std::filesystem::remove(folder / lensProfileName("cam"));
  TexturedGround ground;
  LiveAdjustOptions options = quick();
  options.profiles = folder;
  {
    LiveAdjuster adjuster(options);
    (void)fly(ground, adjuster, 20, 0.05, 0.01);
  }
  const auto profile = readLensProfile(folder / lensProfileName("cam"));
  ASSERT_TRUE(profile) << profile.error().message;
  EXPECT_NEAR(profile->camera.fx, ground.camera.fx, 3 * profile->sigma[0]);
  EXPECT_LT(profile->sigma[0], 0.02 * ground.camera.fx);
  LiveAdjuster next(options);
  (void)next.add(0, *ground.frame(0, 0.05, 0.01), nullptr, 0, 0);
  const auto notes = next.takeNotes();
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_NE(notes[0].find("profile"), std::string::npos);
  EXPECT_DOUBLE_EQ(next.summaryOf("cam")->shared.lens[0], profile->camera.fx);
}

TEST(LensProfile, SaysWhatIsWrongWithAFile) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "camera-bad.json";
  std::ofstream(file) << R"({"format": 1, "kind": "pinhole", "width": 10})";
  const auto read = readLensProfile(file);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::Corrupt);
  EXPECT_NE(read.error().message.find("height"), std::string::npos) << read.error().message;
}

TEST(LensProfile, DoesNotFitAnotherCamera) {
  TexturedGround ground;
  LensProfile profile{ground.camera, {}, 20};
  EXPECT_TRUE(fits(profile, ground.camera));
  auto other = ground.camera;
  other.width = 640;
  EXPECT_FALSE(fits(profile, other));
  other = ground.camera;
  other.fx = other.fy = 600;
  EXPECT_FALSE(fits(profile, other));
}

}  // namespace
}  // namespace overfly::tiling::adjust
