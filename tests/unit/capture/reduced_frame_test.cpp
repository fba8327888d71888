#include "capture/reduced_frame.h"

#include <gtest/gtest.h>

#include "capture/image_decode.h"

namespace overfly::capture {
namespace {

// A point of the picture lies where the reduced camera projects it: a bright spot on dark ground.
TEST(ReducedFrame, ProjectsWhereItsPixelsAre) {
  Frame frame;
  frame.name = "a.jpg";
  Image plain;
  plain.format = PixelFormat::Grey8;
  plain.width = plain.stride = 165;  // no multiple of what it is divided by
  plain.height = 98;
  plain.bytes.assign(165 * 98, 20);
  for (int y = 32; y < 64; ++y)
    for (int x = 64; x < 112; ++x) plain.bytes[static_cast<std::size_t>(y * 165 + x)] = 220;
  frame.camera.width = 165;
  frame.camera.height = 98;
  frame.camera.fx = frame.camera.fy = 150;
  frame.camera.cx = 82.5;
  frame.camera.cy = 49;
  const Eigen::Vector2d spot(88, 48);  // its middle, from the image's corner
  const Eigen::Vector3d ray((spot.x() - 82.5) / 150, (spot.y() - 49) / 150, 1);
  for (const bool jpeg : {false, true}) {
    frame.image = jpeg ? encodeJpeg(plain, 95).value() : plain;
    for (const int divide : {1, 2, 4, 8}) {
      const auto small = reduced(frame, divide);
      ASSERT_TRUE(small) << small.error().message;
      const Frame& f = **small;
      EXPECT_EQ(f.image.width, 165 / divide);
      EXPECT_EQ(f.image.height, 98 / divide);
      EXPECT_EQ(f.camera.width, f.image.width);
      EXPECT_EQ(problemOf(f.image), std::nullopt);
      double x = 0, y = 0, sum = 0;
      for (int j = 0; j < f.image.height; ++j) {
        for (int i = 0; i < f.image.width; ++i) {
          const double value =
              std::max(0, f.image.bytes[static_cast<std::size_t>(j * f.image.stride + 3 * i)] - 100);
          x += value * (i + 0.5);
          y += value * (j + 0.5);
          sum += value;
        }
      }
      EXPECT_NEAR(x / sum, f.camera.cx + f.camera.fx * ray.x(), 0.05) << divide;
      EXPECT_NEAR(y / sum, f.camera.cy + f.camera.fy * ray.y(), 0.05) << divide;
    }
  }
}

TEST(ReducedFrame, RefusesWhatIsNoFraction) {
  Frame frame;
  frame.image.format = PixelFormat::Grey8;
  frame.image.width = frame.image.stride = frame.camera.width = 3;
  frame.image.height = frame.camera.height = 3;
  frame.image.bytes.assign(9, 0);
  EXPECT_EQ(reduced(frame, 3).error().code, ErrorCode::BadInput);
  EXPECT_EQ(reduced(frame, 4).error().code, ErrorCode::BadInput);
  EXPECT_TRUE(reduced(frame, 2));
  frame.camera.height = 5;  // its camera's images have rows that this one lacks
  EXPECT_EQ(reduced(frame, 1).error().code, ErrorCode::BadInput);
}

}  // namespace
}  // namespace overfly::capture
