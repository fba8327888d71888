// Which photographs suit a view, and their pictures.
#include "tiling/preview/frame_projectors.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "capture/geo/footprint.h"

namespace overfly::tiling {
namespace {

using preview::ProjectorQuery;

const geo::Geodetic kSite{geo::radians(47.6712), geo::radians(9.1743), 450};

FrameRecord recordAt(std::uint64_t id, const Eigen::Vector3d& enu, double yaw, double pitch) {
  const geo::LocalFrame local(kSite);
  FrameRecord record;
  record.id = id;
  record.camera.width = 400;
  record.camera.height = 300;
  record.camera.fx = record.camera.fy = 300;
  record.camera.cx = 200;
  record.camera.cy = 150;
  capture::Pose pose;
  pose.position_in_ecef = local.ecefFromEnu(enu);
  pose.ecef_from_camera =
      Eigen::Quaterniond(local.enuFromEcefRotation().transpose()) * geo::enuFromCamera(yaw, pitch, 0);
  record.pose = pose;
  return record;
}

ProjectorQuery queryFrom(const Eigen::Vector3d& enu, double heading, double pitch) {
  ProjectorQuery query;
  query.view.position = geo::geodeticFromEcef(geo::LocalFrame(kSite).ecefFromEnu(enu));
  query.view.heading = heading;
  query.view.pitch = pitch;
  query.far_m = 200;
  return query;
}

Result<capture::Image> grey(const FrameRecord& frame) {
  capture::Image image;
  image.format = capture::PixelFormat::Rgb8;
  image.width = frame.camera.width;
  image.height = frame.camera.height;
  image.stride = 3 * image.width;
  image.bytes.assign(static_cast<std::size_t>(image.stride * image.height), 128);
  return image;
}

// 6.2.1 from its definition: of the frames that see something of what the view sees, at an angle of at most
// Phi max, those taken nearest.
RC_GTEST_PROP(FrameProjectors, AreTheNearestOfThoseThatLookTheSameWayAtTheSamePlace, ()) {
  std::vector<FrameRecord> records;
  for (std::uint64_t id = 1; id <= 40; ++id)
    records.push_back(recordAt(id,
                               {*rc::gen::inRange(-150, 150) * 1.0, *rc::gen::inRange(-150, 150) * 1.0,
                                *rc::gen::inRange(20, 90) * 1.0},
                               *rc::gen::inRange(-314, 314) / 100.0, -*rc::gen::inRange(5, 157) / 100.0));
  ProjectorQuery query = queryFrom({0, 0, 40}, *rc::gen::inRange(-314, 314) / 100.0, -0.5);
  query.count = *rc::gen::inRange(1, 9);
  FrameProjectors projectors(geo::TileLattice::webMercator(), records, 450, grey);
  const auto chosen = projectors.choose(query).value();
  RC_ASSERT(chosen.size() <= static_cast<std::size_t>(query.count));

  const geo::LocalFrame view(query.view.position);
  const Eigen::Vector3d ahead = query.view.enuFromCamera().col(2);
  const auto angleOf = [&](const capture::Pose& pose) {
    const Eigen::Vector3d axis =
        view.enuFromEcefRotation() * (pose.ecef_from_camera * Eigen::Vector3d::UnitZ());
    return std::acos(std::clamp(axis.dot(ahead), -1.0, 1.0));
  };
  const auto awayOf = [&](const Eigen::Vector3d& ecef) { return view.enuFromEcef(ecef).norm(); };
  std::set<std::uint64_t> ids;
  double last = 0;
  for (const auto& projector : chosen) {
    ids.insert(projector.id);
    const FrameRecord& record = records[projector.id - 1];
    RC_ASSERT(angleOf(*record.pose) <= query.max_angle + 1e-9);
    RC_ASSERT(awayOf(projector.position_in_ecef) >= last);
    last = awayOf(projector.position_in_ecef);
  }
  RC_ASSERT(ids.size() == chosen.size());
  for (const FrameRecord& record : records) {
    if (ids.contains(record.id) || angleOf(*record.pose) > query.max_angle - 1e-9) continue;
    // Left out: it sees nothing of what the view sees (points on rays of the view down to the ground), or
    // there are enough nearer ones.
    if (chosen.size() == static_cast<std::size_t>(query.count) &&
        awayOf(record.pose->position_in_ecef) >= last)
      continue;
    for (int y = 0; y <= 4; ++y) {
      for (int x = 0; x <= 4; ++x) {
        const Eigen::Vector3d d =
            query.view.direction(x * query.view.width / 4.0, y * query.view.height / 4.0);
        for (double t = 5; t < 150 && 40 + t * d.z() > 0.5; t += 5) {
          const Eigen::Vector3d p = record.pose->ecef_from_camera.conjugate() *
                                    (view.ecefFromEnu(t * d) - record.pose->position_in_ecef);
          const auto seen = record.camera.project(p);
          RC_ASSERT(!seen || seen->x() < 0 || seen->y() < 0 || seen->x() > 400 || seen->y() > 300);
        }
      }
    }
  }
}

TEST(FrameProjectors, AFrameWithoutAPictureIsNotChosenAgain) {
  std::vector<FrameRecord> records{recordAt(1, {0, -10, 40}, 0, -0.5), recordAt(2, {0, -20, 40}, 0, -0.5),
                                   recordAt(3, {0, -30, 40}, 0, -0.5), recordAt(4, {0, -5, 40}, 0, -0.5)};
  records[3].state = FrameState::Dropped;
  FrameProjectors projectors(geo::TileLattice::webMercator(), records, 450,
                             [](const FrameRecord& frame) -> Result<capture::Image> {
                               if (frame.id == 1) return fail(ErrorCode::NotFound, "no such file");
                               return grey(frame);
                             });
  EXPECT_EQ(projectors.size(), 3u);
  ProjectorQuery query = queryFrom({0, 0, 40}, 0, -0.5);
  query.count = 2;
  auto chosen = projectors.choose(query).value();
  ASSERT_EQ(chosen.size(), 2u);
  EXPECT_EQ(chosen[0].id, 1u);
  EXPECT_EQ(chosen[1].id, 2u);
  EXPECT_FALSE(projectors.load(1, 64, 48).has_value());
  EXPECT_TRUE(projectors.load(2, 64, 48).has_value());
  chosen = projectors.choose(query).value();
  ASSERT_EQ(chosen.size(), 2u);
  EXPECT_EQ(chosen[0].id, 2u);
  EXPECT_EQ(chosen[1].id, 3u);
}

// Red is the source's column, green its row.
TEST(FrameProjectors, PicturesAreUndistortedAndScaled) {
  capture::CameraModel camera;
  camera.kind = capture::CameraModel::Kind::RadialTangential;
  camera.width = 480;
  camera.height = 320;
  camera.fx = camera.fy = 300;
  camera.cx = 236;
  camera.cy = 165;
  camera.distortion = {-0.12, 0.01, 0.001, -0.0005};
  capture::Image image;
  image.format = capture::PixelFormat::Rgb8;
  image.width = camera.width;
  image.height = camera.height;
  image.stride = 3 * image.width;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      image.bytes.insert(image.bytes.end(),
                         {static_cast<std::uint8_t>(x / 2), static_cast<std::uint8_t>(y / 2), 77});
  for (const auto& [width, height] : {std::pair{256, 256}, std::pair{100, 60}}) {
    const auto out = undistortedImage(image, camera, width, height);
    ASSERT_TRUE(out.has_value()) << out.error().message;
    EXPECT_EQ(out->pinhole.width, width);
    EXPECT_EQ(out->pinhole.height, height);
    int valid = 0;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const std::uint8_t* p = &out->rgba[static_cast<std::size_t>(4 * (y * width + x))];
        const auto at = camera.project({(x + 0.5 - out->pinhole.cx) / out->pinhole.fx,
                                        (y + 0.5 - out->pinhole.cy) / out->pinhole.fy, 1});
        const bool inside = at && at->x() > 0.5 && at->y() > 0.5 && at->x() < camera.width - 0.5 &&
                            at->y() < camera.height - 0.5;
        if (!inside) continue;
        ++valid;
        ASSERT_EQ(p[3], 255) << x << ", " << y;
        ASSERT_NEAR(2 * p[0] + 1, at->x(), 3) << x << ", " << y;
        ASSERT_NEAR(2 * p[1] + 1, at->y(), 3) << x << ", " << y;
        ASSERT_EQ(p[2], 77);
      }
    }
    EXPECT_GT(valid, width * height / 2);
    // A pinhole that holds all of a barrel's picture reaches its corners, and beyond its sides.
    EXPECT_EQ(out->rgba[static_cast<std::size_t>(4 * (height / 2) * width + 3)], 0);
  }
  image.width = 479;
  EXPECT_FALSE(undistortedImage(image, camera, 64, 64).has_value());
}

}  // namespace
}  // namespace overfly::tiling
