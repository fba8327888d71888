#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "tests/unit/adjust/simulated_tracks.h"
#include "tiling/adjust/pose_map.h"

// Flights that break pose adjustment elsewhere: either the pose is right within its stated covariance, or it
// is refused with the reason.
namespace overfly::tiling::adjust {
namespace {

using tests::SimulatedSettings;
using tests::SimulatedTracks;
using tests::TruthMatcher;

SimulatedSettings ordinary() {
  SimulatedSettings s;
  s.points_per_frame = 200;
  s.legs = 3;
  s.frames_per_leg = 8;
  s.gnss_noise_m = 0.5;
  s.attitude_noise = 0.01;
  return s;
}

struct Flown {
  std::vector<FrameUpdate> updates;
  PoseMap::Summary summary;
  std::map<FrameId, int> frame_of;  // frame of the simulation
  [[nodiscard]] int count(FrameState state) const {
    return static_cast<int>(
        std::count_if(updates.begin(), updates.end(), [&](const auto& u) { return u.state == state; }));
  }
};

// Flies the given frames of the simulation in the given order; `change` may spoil telemetry and pictures.
Flown fly(SimulatedTracks& tracks, const std::vector<int>& order,
          const std::function<void(int frame, PriorPose&, SimulatedTracks::Picture&)>& change = {}) {
  PoseMap map(tracks.nominal, {});
  TruthMatcher matcher(0.03);
  Flown out;
  FrameId id = 0;
  for (const int i : order) {
    auto picture = tracks.take(i);
    auto prior = tracks.telemetry(i);
    if (change) change(i, prior, picture);
    auto pixels = picture.pixels;
    matcher.add(id, std::move(picture));
    out.frame_of[id] = i;
    map.add(id, prior, std::move(pixels), matcher);
    ++id;
  }
  out.updates = map.adjustAll(matcher);
  out.summary = map.summary();
  return out;
}

std::vector<int> inOrder(int n) {
  std::vector<int> order(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) order[static_cast<std::size_t>(i)] = i;
  return order;
}

// Largest error of the adjusted frames in their own sigmas, and in metres.
std::pair<double, double> worst(const Flown& flown, const SimulatedTracks& tracks) {
  double sigmas = 0, metres = 0;
  for (const auto& u : flown.updates) {
    if (u.state != FrameState::Adjusted) continue;
    const auto truth = tracks.at(tracks.time(flown.frame_of.at(u.id)));
    Eigen::Matrix<double, 6, 1> e;
    e << u.position - truth.position, rotationVector(u.enu_from_camera * truth.enu_from_camera.conjugate());
    for (int k = 0; k < 6; ++k) sigmas = std::max(sigmas, std::abs(e[k]) / std::sqrt(u.covariance(k, k)));
    metres = std::max(metres, e.head<3>().norm());
  }
  fmt::print("{} adjusted of {}, worst {:.2f} m, {:.2f} sigma, rms {:.2f} px\n",
             flown.count(FrameState::Adjusted), flown.updates.size(), metres, sigmas, flown.summary.rms_px);
  return {sigmas, metres};
}

TEST(HardCases, PureRotationIsRefusedAsWithoutParallax) {
  SimulatedTracks tracks(ordinary());
  tracks.turning_only = true;
  const Flown flown = fly(tracks, inOrder(12));
  EXPECT_EQ(flown.count(FrameState::Adjusted), 0);
  int said = 0;
  for (const auto& u : flown.updates) said += u.reason.find("no parallax") != std::string::npos ? 1 : 0;
  EXPECT_EQ(said, 11);  // the first had nothing to be compared with
}

TEST(HardCases, StraightLegStatesThatRollAboutItIsWeak) {
  auto settings = ordinary();
  settings.attitude_noise = 0.03;
  SimulatedTracks tracks(settings);
  tracks.straight = true;
  const Flown flown = fly(tracks, inOrder(11));
  EXPECT_EQ(flown.count(FrameState::Adjusted), 11);
  EXPECT_LT(worst(flown, tracks).first, 3.5);
  const auto& middle = flown.updates[5];  // flown east: roll is about x, pitch about y
  EXPECT_GT(middle.covariance(3, 3), 2 * middle.covariance(4, 4));
}

// What bends a block of legs over flat ground: pitch that is wrong in the same way on every leg.
TEST(HardCases, AHorizonThatSettlesAfterEachTurnDoesNotBendTheBlock) {
  SimulatedSettings settings;
  settings.points_per_frame = 40;
  settings.legs = 4;
  settings.frames_per_leg = 10;
  settings.height_m = 40;
  settings.relief_m = 0.3;
  settings.spacing_m = 18;
  settings.speed_mps = 5;
  settings.wobble = 0.002;
  settings.gnss_noise_m = 0.3;
  settings.attitude_noise = 0.002;
  settings.horizon_drift = 0.035;
  SimulatedTracks tracks(settings);
  const Flown flown = fly(tracks, inOrder(tracks.frames()));
  EXPECT_EQ(flown.count(FrameState::Adjusted), tracks.frames());
  EXPECT_LT(worst(flown, tracks).first, 3.5);
  const auto& s = flown.summary;
  EXPECT_LT(std::abs(s.shared.lens[3] - tracks.camera.distortion[0]), 3 * s.sigmas.lens[3]);
}

TEST(HardCases, FramesThatSeeNothingInCommonAreHeldBackWithTheReason) {
  auto settings = ordinary();
  settings.spacing_m = 150;  // more than a footprint
  SimulatedTracks tracks(settings);
  const Flown flown = fly(tracks, {3, 11, 19});
  EXPECT_EQ(flown.count(FrameState::HeldBack), 3);
  for (const auto& u : flown.updates) EXPECT_FALSE(u.reason.empty());
  EXPECT_NE(flown.updates.back().reason.find("no overlap"), std::string::npos) << flown.updates.back().reason;
}

TEST(HardCases, GnssJumpOfOneFrameDoesNotMoveIt) {
  SimulatedTracks tracks(ordinary());
  const Flown flown = fly(tracks, inOrder(tracks.frames()), [](int i, PriorPose& prior, auto&) {
    if (i == 11) prior.position += Eigen::Vector3d(40, -30, 5);
  });
  EXPECT_EQ(flown.count(FrameState::Adjusted), tracks.frames());
  const auto [sigmas, metres] = worst(flown, tracks);
  EXPECT_LT(metres, 1.5);
  EXPECT_LT(sigmas, 3.5);
}

TEST(HardCases, SamePictureTwiceIsNotCountedTwice) {
  SimulatedTracks tracks(ordinary());
  auto order = inOrder(tracks.frames());
  order.insert(order.begin() + 10, 9);
  SimulatedTracks::Picture ninth;
  const Flown flown = fly(tracks, order, [&](int i, PriorPose& prior, SimulatedTracks::Picture& picture) {
    if (i != 9) return;
    if (ninth.pixels.empty())
      ninth = picture;
    else
      picture = ninth, prior.time_ns += 1000;
  });
  EXPECT_EQ(flown.count(FrameState::Adjusted), tracks.frames());
  const auto twin =
      std::find_if(flown.updates.begin(), flown.updates.end(), [](const auto& u) { return u.id == 10; });
  ASSERT_NE(twin, flown.updates.end());
  EXPECT_NE(twin->reason.find("the same picture as frame 9"), std::string::npos) << twin->reason;
  EXPECT_LT(worst(flown, tracks).first, 3.5);
}

TEST(HardCases, OrderOfArrivalDoesNotMatter) {
  SimulatedTracks tracks(ordinary());
  auto order = inOrder(tracks.frames());
  for (std::size_t i = 0; i + 3 < order.size(); i += 4) std::swap(order[i], order[i + 3]);
  const Flown flown = fly(tracks, order);
  EXPECT_EQ(flown.count(FrameState::Adjusted), tracks.frames());
  EXPECT_LT(worst(flown, tracks).first, 3.5);
}

TEST(HardCases, HalfTheFramesLost) {
  SimulatedTracks tracks(ordinary());
  std::vector<int> order;
  for (int i = 0; i < tracks.frames(); i += 2) order.push_back(i);
  const Flown flown = fly(tracks, order);
  EXPECT_EQ(flown.count(FrameState::Adjusted), static_cast<int>(order.size()));
  EXPECT_LT(worst(flown, tracks).first, 3.5);
}

TEST(HardCases, FeaturelessFramesAreHeldBack) {
  SimulatedTracks tracks(ordinary());
  const Flown flown =
      fly(tracks, inOrder(tracks.frames()), [](int i, PriorPose&, SimulatedTracks::Picture& picture) {
        if (i < 5 || i > 7) return;  // water: a few specks that do not repeat
        picture.pixels.resize(12);
        picture.ids.assign(12, 0);
        for (int k = 0; k < 12; ++k) picture.ids[static_cast<std::size_t>(k)] = 10'000'000 + 100 * i + k;
      });
  EXPECT_EQ(flown.count(FrameState::Adjusted), tracks.frames() - 3);
  EXPECT_LT(worst(flown, tracks).first, 3.5);
}

// Ground control brings the map to its place, and check points tell how well.
TEST(HardCases, ControlPointsCorrectTheReceiversOffset) {
  auto settings = ordinary();
  settings.gnss_noise_m = 0.3;
  SimulatedTracks tracks(settings);
  PoseMap map(tracks.nominal, {});
  TruthMatcher matcher(0.03);
  const Eigen::Vector3d offset(1.5, -2, 3);
  for (int i = 0; i < tracks.frames(); ++i) {
    auto picture = tracks.take(i);
    auto prior = tracks.telemetry(i);
    prior.position += offset;
    prior.covariance.diagonal().head<3>().setConstant(4);
    auto pixels = picture.pixels;
    matcher.add(static_cast<FrameId>(i), std::move(picture));
    map.add(static_cast<FrameId>(i), prior, std::move(pixels), matcher);
  }
  const std::array<Eigen::Vector2d, 6> places{Eigen::Vector2d(20, 5),   {110, 10}, {30, 60},
                                              Eigen::Vector2d(100, 65), {60, 35},  {85, 20}};
  for (std::size_t k = 0; k < places.size(); ++k) {
    PoseMap::Control control;
    control.name = fmt::format("p{}", k);
    control.position << places[k], SimulatedTracks::ground(places[k].x(), places[k].y(), settings.relief_m);
    control.check = k >= 4;
    for (int i = 0; i < tracks.frames(); ++i) {
      const auto truth = tracks.at(tracks.time(i));
      const auto px =
          tracks.camera.project(truth.enu_from_camera.conjugate() * (control.position - truth.position));
      if (px && px->x() > 20 && px->y() > 20 && px->x() < tracks.camera.width - 20 &&
          px->y() < tracks.camera.height - 20)
        control.seen.emplace_back(static_cast<FrameId>(i), *px);
    }
    ASSERT_GE(control.seen.size(), 2U) << k;
    map.control().push_back(control);
  }
  (void)map.adjustAll(matcher);
  for (const auto& control : map.control()) {
    ASSERT_TRUE(control.residual_m) << control.name;
    EXPECT_LT(control.residual_m->head<2>().norm(), 0.08) << control.name;
    EXPECT_LT(std::abs(control.residual_m->z()), 0.2) << control.name;
  }
  EXPECT_LT((map.summary().shared.offset_m - offset).norm(), 0.5);
}

// Rows and water: hundreds of keypoints, none of which comes again.
TEST(HardCases, WavesThatNeverRepeatAreHeldBack) {
  SimulatedTracks tracks(ordinary());
  const Flown flown =
      fly(tracks, inOrder(tracks.frames()), [](int i, PriorPose&, SimulatedTracks::Picture& picture) {
        if (i < 5 || i > 7) return;
        for (std::size_t k = 0; k < picture.ids.size(); ++k)
          picture.ids[k] = 10'000'000 + 10'000 * i + static_cast<int>(k);
      });
  EXPECT_EQ(flown.count(FrameState::Adjusted), tracks.frames() - 3);
  EXPECT_LT(worst(flown, tracks).first, 3.5);
}

// Live, frame by frame, without the adjustment after landing: the newest frames are held by older ones, and
// all of them by a receiver of 2 m. The mean of a region's 80 fixes is good to 0.2 m in each axis.
TEST(HardCases, ALongFlightDoesNotDriftAwayFromItsTelemetry) {
  SimulatedSettings settings;
  settings.points_per_frame = 120;
  settings.legs = 9;
  settings.frames_per_leg = 20;
  settings.gnss_noise_m = 2;
  settings.attitude_noise = 0.01;
  SimulatedTracks tracks(settings);
  PoseMap map(tracks.nominal, {});
  TruthMatcher matcher(0.03);
  double worst_m = 0;
  for (int i = 0; i < tracks.frames(); ++i) {
    auto picture = tracks.take(i);
    auto pixels = picture.pixels;
    matcher.add(static_cast<FrameId>(i), std::move(picture));
    for (const auto& u : map.add(static_cast<FrameId>(i), tracks.telemetry(i), std::move(pixels), matcher))
      if (u.id >= 30 && u.state == FrameState::Adjusted)
        worst_m =
            std::max(worst_m, (u.position - tracks.at(tracks.time(static_cast<int>(u.id))).position).norm());
  }
  fmt::print("worst {:.2f} m\n", worst_m);
  EXPECT_LT(worst_m, 2.0);
}

TEST(HardCases, WithoutAttitudeCourseAndNadirAreEnough) {
  auto settings = ordinary();
  settings.gnss_noise_m = 3;
  settings.delay_s = 2;
  SimulatedTracks tracks(settings);
  std::vector<PriorPose> said;
  const Flown flown = fly(tracks, inOrder(tracks.frames()), [&](int, PriorPose& prior, auto&) {
    said.push_back(prior);
    const Eigen::Vector3d way = said.size() < 2
                                    ? Eigen::Vector3d(1, 0, 0)
                                    : Eigen::Vector3d(prior.position - said[said.size() - 2].position);
    prior.enu_from_camera = geo::enuFromCamera(std::atan2(way.x(), way.y()), -M_PI / 2, 0);
    prior.covariance.diagonal() << 25, 25, 900, 0.03, 0.03, 0.6;
    prior.position.z() += 100 + 0.5 * static_cast<double>(prior.time_ns) * 1e-9;
  });
  EXPECT_GE(flown.count(FrameState::Adjusted), tracks.frames() * 9 / 10);
  EXPECT_NEAR(flown.summary.shared.delay_s, 2, 1);
  EXPECT_LT(flown.summary.rms_px, 1);
}

}  // namespace
}  // namespace overfly::tiling::adjust
