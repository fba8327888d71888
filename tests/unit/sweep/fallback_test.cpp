// The five ways to colour ground whose height is not known (thesis 5.4, figure 5.6).
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/sweep/gpu_photos.h"

namespace overfly::tiling {
namespace {

using test::kFlight;
using test::kGround;

class FallbackTest : public test::GlTest {
 protected:
  static constexpr int kSize = 64;
  // Three frames of one grey each, from west to east over the cell of 26 m.
  static Orthophoto render(Fallback fallback, std::array<int, 3> grey = {40, 200, 60}) {
    const test::Scene scene{[](double, double) { return kGround; }, {}};
    std::vector<test::Photo> photos;
    for (std::size_t k = 0; k < 3; ++k) {
      photos.push_back(
          test::takePhoto(scene, test::sceneCamera(120, 100),
                          test::lookDown(8.0 * static_cast<double>(k) - 8, 0, kGround + kFlight)));
      for (std::size_t i = 0; i < photos.back().rgba.size(); ++i)
        if (i % 4 != 3) photos.back().rgba[i] = static_cast<std::uint8_t>(grey[k]);
    }
    const test::GpuPhotos gpu(context(), photos);
    auto orthographer = Orthographer::create(context());
    if (!orthographer) throw std::runtime_error(orthographer.error().message);
    const std::vector<float> height(80 * 80, static_cast<float>(kGround));
    const std::vector<std::uint8_t> provisional(80 * 80, 1);
    auto photo =
        (*orthographer)
            ->render({&test::sceneFrame(), kSize, 8, height, provisional}, gpu.orthoViews(), kSize, fallback);
    if (!photo) throw std::runtime_error(photo.error().message);
    for (std::size_t i = 0; i < photo->source.size(); ++i) {
      EXPECT_EQ(photo->provisional[i], 1);
      EXPECT_EQ(photo->seen_by[i], 3);
    }
    return std::move(*photo);
  }
  // Row 32: red values at the west rim, in the middle, at the east rim.
  static std::array<int, 3> across(const Orthophoto& photo) {
    const auto at = [&](int x) { return photo.color[4 * static_cast<std::size_t>(32 * kSize + x)]; };
    return {at(2), at(32), at(61)};
  }
};

TEST_F(FallbackTest, NearestToTheImagesCentre) {
  const Orthophoto photo = render(Fallback::ImageCentre);
  EXPECT_EQ(across(photo), (std::array{40, 200, 60}));
  EXPECT_EQ(photo.source[32 * kSize + 2], 0);
  EXPECT_EQ(photo.source[32 * kSize + 61], 2);
  // The line of sight leans the more the farther the texel is from the point below the camera.
  EXPECT_LT(photo.tilt[32 * kSize + 32], 0.02f);
  EXPECT_NEAR(photo.tilt[32 * kSize + 61], 4.0 / kFlight, 0.02);
}

TEST_F(FallbackTest, AverageIsTheMeanEverywhere) {
  for (const int value : across(render(Fallback::Average))) EXPECT_NEAR(value, 100, 1);
}

TEST_F(FallbackTest, BlendLeansTowardsTheImageWhoseBorderIsFar) {
  const std::array<int, 3> value = across(render(Fallback::Blend, {0, 0, 240}));
  EXPECT_GT(value[2], value[1]);
  EXPECT_GT(value[1], value[0]);
  EXPECT_GT(value[0], 0);
  EXPECT_LT(value[2], 240);
}

TEST_F(FallbackTest, OverwriteShowsTheLast) {
  const Orthophoto photo = render(Fallback::Overwrite);
  EXPECT_EQ(across(photo), (std::array{60, 60, 60}));
  EXPECT_EQ(photo.source[32 * kSize + 2], 2);
}

TEST_F(FallbackTest, LowestCostLeavesTheOddOneOut) {
  for (const int value : across(render(Fallback::LowestCost, {50, 220, 60}))) EXPECT_LE(value, 60);
  for (const int value : across(render(Fallback::LowestCost, {220, 55, 60}))) EXPECT_LE(value, 60);
}

}  // namespace
}  // namespace overfly::tiling
