// A second camera's pictures on a surface that is given.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/sweep/mapper_scene.h"

namespace overfly::tiling {
namespace {

using test::kFlight;
using test::kGround;
using test::kTile;

class Drape : public test::GlTest {
 protected:
  static Eigen::Vector2d placeOf(int x, int y) {
    return test::sceneFrame().enuFromTexelExact((x + 0.5) / kTile, (y + 0.5) / kTile, kGround).head<2>();
  }
  // What a camera of another kind and half the resolution sees: one channel, bright where the first one sees
  // dark.
  static capture::FramePtr otherCamera(std::uint64_t id, const test::Photo& photo) {
    auto frame = std::make_shared<capture::Frame>(*test::frameOf(id, photo, static_cast<double>(id)));
    frame->image.format = capture::PixelFormat::Grey8;
    frame->image.stride = frame->image.width;
    frame->image.bytes.clear();
    for (std::size_t i = 0; i < photo.rgba.size(); i += 4)
      frame->image.bytes.push_back(static_cast<std::uint8_t>(255 - photo.rgba[i]));
    return frame;
  }
};

TEST_F(Drape, PicturesOfASecondCameraLieWhereTheSurfaceSaysAndNowhereElse) {
  test::Scene scene{[](double, double) { return kGround; }, test::Box{-4, -3, 3, 2, kGround + 4},
                    test::Pattern(5, 1.2)};
  auto mapper = test::sceneMapper(context());
  for (int i = 0; i < 12; ++i)
    test::add(*mapper, otherCamera(static_cast<std::uint64_t>(i),
                                   test::takePhoto(scene, test::sceneCamera(100, kFlight / 0.4),
                                                   test::lookDown(8.0 * (i % 4) - 12, 9.0 * (i / 4) - 9,
                                                                  kGround + kFlight))));
  std::array<std::vector<float>, 9> heights;
  heights[4].assign(std::size_t{kTile} * kTile, 0);
  const auto at = [](int x, int y) {
    return static_cast<std::size_t>(y) * kTile + static_cast<std::size_t>(x);
  };
  for (int y = 0; y < kTile; ++y)
    for (int x = 0; x < kTile; ++x) {
      const Eigen::Vector2d p = placeOf(x, y);
      heights[4][at(x, y)] = x < 8 ? NAN : static_cast<float>(scene.height(p.x(), p.y()));
    }
  auto tiles = mapper->colourOn(test::sceneFrame().key(), heights);
  ASSERT_TRUE(tiles) << tiles.error().message;
  ASSERT_EQ(tiles->size(), 1u);
  const Tile& tile = tiles->front();
  // Mean distance of the colour from the truth on the roof, on the ground and on the ground close to the
  // walls.
  std::array<double, 3> sum{}, count{};
  for (int y = 2; y < kTile - 2; ++y)
    for (int x = 0; x < kTile - 2; ++x) {
      const std::uint8_t* color = &tile.color[4 * at(x, y)];
      if (x < 8) {
        EXPECT_EQ(color[3], 0) << "a colour without a surface";
        continue;
      }
      const Eigen::Vector2d p = placeOf(x, y);
      const test::Box& box = *scene.box;
      const double inside =
          std::min({p.x() - box.west, box.east - p.x(), p.y() - box.south, box.north - p.y()});
      if (std::abs(inside) < 0.5) continue;
      const std::size_t kind = inside > 0 ? 0 : inside < -2 ? 1 : 2;
      const Eigen::Vector3d point(p.x(), p.y(), scene.height(p.x(), p.y()));
      const double truth =
          1 - scene.colour({point, inside > 0 ? test::Scene::Surface::Roof : test::Scene::Surface::Ground}).x();
      EXPECT_EQ(color[3], 255);
      sum.at(kind) += std::abs(color[0] / 255.0 - truth);
      count.at(kind) += 1;
    }
  std::printf("drape: mean error of colour on the roof %.3f, the ground %.3f, beside the walls %.3f\n",
              sum[0] / count[0], sum[1] / count[1], sum[2] / count[2]);
  for (std::size_t kind = 0; kind < 3; ++kind) EXPECT_LT(sum.at(kind) / count.at(kind), 0.04) << kind;
}

}  // namespace
}  // namespace overfly::tiling
