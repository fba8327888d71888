// Colour of steep sides from photographs, against rays in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "render/preview/previewer.h"
#include "render/preview/reference_caster.h"
#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/preview/photo_ring.h"
#include "tests/unit/preview/synthetic_map.h"

namespace overfly::preview {
namespace {

using test::PhotoRing;
using test::SyntheticMap;

View cameraAt(const SyntheticMap& map, double x, double y, double height, double heading_deg,
              double pitch_deg) {
  View view;
  view.position = map.place(x, y, height);
  view.heading = geo::radians(heading_deg);
  view.pitch = geo::radians(pitch_deg);
  view.width = 1024;
  view.height = 768;
  return view;
}

// Red and green tell where in the photograph a colour comes from, blue from which.
PhotoRing::Rgb coordinates(double u, double v, std::size_t index) {
  return {static_cast<std::uint8_t>(std::lround(255 * u)), static_cast<std::uint8_t>(std::lround(255 * v)),
          static_cast<std::uint8_t>(20 + 25 * index)};
}

class Lateral : public test::GlTest, public ::testing::WithParamInterface<Surface> {
 protected:
  Lateral()
      : map({}, test::townHeight),
        ram(map),
        photos({cameraAt(map, 200, 420, 475, 0, -35), cameraAt(map, 90, 330, 465, 60, -30),
                cameraAt(map, 330, 340, 490, -50, -45), cameraAt(map, 190, 360, 462, 10, -25),
                cameraAt(map, 210, 120, 470, 180, -30), cameraAt(map, 120, 400, 480, 30, -40),
                cameraAt(map, 290, 390, 470, -30, -35), cameraAt(map, 200, 250, 520, 0, -88)},
               coordinates),
        previewer(context(), ram) {
    previewer.setProjectors(&photos);
    view = cameraAt(map, 200, 330, 461, 0, -22);
    view.width = 144;
    view.height = 96;
    look.surface = GetParam();
    look.relief = 0;
    look.level_of_detail = false;
    look.filter = Filter::Bilinear;
  }
  [[nodiscard]] const std::uint8_t* pixel(const Picture& picture, int x, int y) const {
    return &picture.rgba[static_cast<std::size_t>(4 * (y * view.width + x))];
  }

  SyntheticMap map;
  RamCache ram;
  PhotoRing photos;
  Previewer previewer;
  View view;
  Look look;
};

int difference(const std::uint8_t* a, const std::uint8_t* b) {
  return std::max({std::abs(a[0] - b[0]), std::abs(a[1] - b[1]), std::abs(a[2] - b[2])});
}

// The nearest photograph that shows a point of the surface, and where in it, in double: a ray from its centre
// to the point meets nothing before it.
struct Shown {
  std::size_t photo;
  Eigen::Vector2d uv;
};
std::optional<Shown> shownBy(const PhotoRing& photos, std::size_t count, const ReferenceCaster& reference,
                             const std::vector<RayFrame>& frames, const geo::Geodetic& place,
                             double slack_m) {
  std::optional<Shown> best;
  double nearest = 1e30;
  for (std::size_t k = 0; k < count; ++k) {
    const View& camera = photos.cameras()[k];
    const Eigen::Vector3d way = geo::LocalFrame(camera.position).enuFromEcef(geo::ecefFromGeodetic(place));
    const Eigen::Vector3d p = camera.enuFromCamera().transpose() * way;
    const Eigen::Vector2d uv(0.5 + camera.focal() * p.x() / p.z() / camera.width,
                             0.5 + camera.focal() * p.y() / p.z() / camera.height);
    if (p.z() <= 0 || uv.minCoeff() < 0 || uv.maxCoeff() > 1 || way.norm() >= nearest) continue;
    const auto hit = reference.cast(frames[k], way.normalized(), way.norm() + 1);
    if (hit && hit->t < way.norm() - slack_m) continue;
    nearest = way.norm();
    best = Shown{k, uv};
  }
  return best;
}

TEST_P(Lateral, TheNearestPhotographThatShowsAPointColoursIt) {
  look.lateral_slope = 0;  // all of the surface
  look.projector_grazing = 0;
  for (const int count : {1, 3, 8}) {
    look.projectors = 0;
    const auto plain = previewer.drawSettled(view, look);
    ASSERT_TRUE(plain.has_value()) << plain.error().message;
    look.projectors = count;
    const auto drawn = previewer.drawSettled(view, look, true);
    ASSERT_TRUE(drawn.has_value()) << drawn.error().message;
    EXPECT_EQ(drawn->projectors, count);
    const Domain& domain = previewer.cache()->domain();
    const HeightGrid grid = HeightGrid::load(domain, map, 0).value();
    const ReferenceCaster reference(grid, GetParam());
    std::vector<RayFrame> frames;
    for (const View& camera : photos.cameras())
      frames.push_back(RayFrame::create(domain, camera.position, previewer.cache()->baseHeight()).value());
    int compared = 0, differ = 0, projected = 0;
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const auto hit = reference.cast(*previewer.frame(), view.direction(x + 0.5, y + 0.5), 60000);
        const RayHit& found = drawn->picture.hits[static_cast<std::size_t>(y * view.width + x)];
        if (!hit || !found.found || std::abs(hit->t - found.t) > 0.01) continue;
        geo::Geodetic place = domain.lattice().geodeticFromPlane(domain.planeFromTexel(hit->texel));
        place.height_m = hit->height_m;
        // A step that hides the point by little may be one that the secondary ray, lifted by 0.6 texel (0.12
        // m), passes over at a low angle: either answer is right.
        bool agrees = false, any = false;
        for (const double slack_m : {0.03, 0.3}) {
          const auto shown =
              shownBy(photos, static_cast<std::size_t>(count), reference, frames, place, slack_m);
          any = any || shown;
          std::uint8_t expected[3];
          if (shown) {
            const auto color = coordinates(shown->uv.x(), shown->uv.y(), shown->photo);
            expected[0] = color.r;
            expected[1] = color.g;
            expected[2] = color.b;
          } else {
            std::copy_n(pixel(plain->picture, x, y), 3, expected);
          }
          agrees = agrees || difference(pixel(drawn->picture, x, y), expected) <= 3;
        }
        ++compared;
        projected += any ? 1 : 0;
        differ += agrees ? 0 : 1;
      }
    }
    std::printf("surface %d, %d photographs: %d of %d pixels differ, %d projected\n",
                static_cast<int>(GetParam()), count, differ, compared, projected);
    EXPECT_GT(compared, view.width * view.height / 2);
    EXPECT_GT(projected, compared / 5);
    EXPECT_LE(differ, compared / 28);  // within 0.12 m of where one comes into sight
  }
}

TEST_P(Lateral, OnlySteepSidesAreColouredAndOnlyInColour) {
  const auto plain = previewer.drawSettled(view, look);
  ASSERT_TRUE(plain.has_value()) << plain.error().message;
  look.projectors = 4;
  const auto drawn = previewer.drawSettled(view, look, true);
  ASSERT_TRUE(drawn.has_value()) << drawn.error().message;
  const HeightGrid grid = HeightGrid::load(previewer.cache()->domain(), map, 0).value();
  int changed = 0, flat = 0, wrong = 0;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const bool same = difference(pixel(plain->picture, x, y), pixel(drawn->picture, x, y)) == 0;
      changed += same ? 0 : 1;
      const RayHit& hit = drawn->picture.hits[static_cast<std::size_t>(y * view.width + x)];
      if (!hit.found) continue;
      // No side within the texel and its neighbours. (Between blocks every step is one.)
      const Eigen::Vector2i cell = hit.texel.array().floor().cast<int>();
      double low = 1e9, high = -1e9;
      for (int v = -1; v <= 1; ++v) {
        for (int u = -1; u <= 1; ++u) {
          if (!grid.inside(cell.x() + u, cell.y() + v)) continue;
          low = std::min(low, static_cast<double>(grid.at(cell.x() + u, cell.y() + v)));
          high = std::max(high, static_cast<double>(grid.at(cell.x() + u, cell.y() + v)));
        }
      }
      const bool top = std::abs(hit.height_m - static_cast<double>(grid.at(cell.x(), cell.y()))) < 1e-4;
      if (GetParam() == Surface::Blocks ? top : high - low < 0.2) {
        ++flat;
        wrong += same ? 0 : 1;
      }
    }
  }
  EXPECT_GT(flat, view.width * view.height / 6);
  EXPECT_LE(wrong, flat / 1000);  // where a ray meets an edge, it is a matter of rounding which side it is
  EXPECT_GT(changed, view.width * view.height / 50);
  look.mode = Mode::Elevation;
  const auto elevation = previewer.drawSettled(view, look);
  look.projectors = 0;
  const auto without = previewer.drawSettled(view, look);
  ASSERT_TRUE(elevation.has_value() && without.has_value());
  EXPECT_EQ(elevation->picture.rgba, without->picture.rgba);
}
INSTANTIATE_TEST_SUITE_P(Surfaces, Lateral, ::testing::Values(Surface::Blocks, Surface::Linear));

using Photographs = test::GlTest;
TEST_F(Photographs, AreLoadedOneAFrameAndOnlyOnce) {
  SyntheticMap map({}, test::townHeight);
  RamCache ram(map);
  PhotoRing photos({cameraAt(map, 200, 420, 475, 0, -35), cameraAt(map, 90, 330, 465, 60, -30),
                    cameraAt(map, 330, 340, 490, -50, -45)},
                   coordinates);
  Previewer previewer(context(), ram);
  previewer.setProjectors(&photos);
  View view = cameraAt(map, 200, 330, 461, 0, -22);
  view.width = view.height = 16;
  Look look;
  ASSERT_TRUE(previewer.drawSettled(view, look).has_value());
  EXPECT_EQ(photos.loads, 0);
  look.projectors = 3;
  for (const int there : {1, 2, 3, 3}) {
    const auto frame = previewer.draw(view, look, {});
    ASSERT_TRUE(frame.has_value()) << frame.error().message;
    EXPECT_EQ(frame->projectors, there);
    EXPECT_EQ(photos.loads, there);
  }
  // The view sees the ground at its upper edge, 14 m below and 5 deg to the horizon.
  EXPECT_GT(photos.last.far_m, 30);
  EXPECT_LT(photos.last.far_m, 300);
  look.projectors = 1;
  const auto fewer = previewer.draw(view, look, {});
  ASSERT_TRUE(fewer.has_value());
  EXPECT_EQ(fewer->projectors, 1);
  EXPECT_EQ(photos.loads, 3);
  look.projectors = 0;
  EXPECT_EQ(previewer.draw(view, look, {})->projectors, 0);
  look.projectors = 3;
  EXPECT_EQ(previewer.draw(view, look, {})->projectors, 3);
  EXPECT_EQ(photos.loads, 3);
}

TEST_F(Photographs, ThatAreStillBeingReadAreAskedForAgain) {
  SyntheticMap map({}, test::townHeight);
  RamCache ram(map);
  PhotoRing photos({cameraAt(map, 200, 420, 475, 0, -35), cameraAt(map, 90, 330, 465, 60, -30)}, coordinates);
  Previewer previewer(context(), ram);
  previewer.setProjectors(&photos);
  View view = cameraAt(map, 200, 330, 461, 0, -22);
  view.width = view.height = 16;
  Look look;
  ASSERT_TRUE(previewer.drawSettled(view, look).has_value());
  look.projectors = 2;
  photos.reading = true;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(previewer.refine(view, look, {}).has_value());
    EXPECT_EQ(previewer.projectorsLeft(), 2);
  }
  EXPECT_EQ(previewer.draw(view, look, {})->projectors, 0);
  photos.reading = false;
  for (const int left : {1, 0, 0}) {
    ASSERT_TRUE(previewer.refine(view, look, {}).has_value());
    EXPECT_EQ(previewer.projectorsLeft(), left);
  }
  EXPECT_EQ(photos.loads, 2);
  EXPECT_EQ(previewer.draw(view, look, {})->projectors, 2);
}

}  // namespace
}  // namespace overfly::preview
