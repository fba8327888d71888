// Pictures: against stored ones on the software rasteriser, and while the map changes beneath them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "render/preview/previewer.h"
#include "render/preview/reference_caster.h"
#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/preview/photo_ring.h"
#include "tests/unit/preview/synthetic_map.h"

namespace overfly::preview {
namespace {

using test::SyntheticMap;

View viewOf(const SyntheticMap& map, double x, double y, double above, double heading_deg, double pitch_deg) {
  View view;
  view.position = map.place(x, y, 447 + above);
  view.heading = geo::radians(heading_deg);
  view.pitch = geo::radians(pitch_deg);
  view.width = 192;
  view.height = 128;
  return view;
}

struct Golden {
  const char* name;
  Look look;
  bool near = true;
};

std::vector<Golden> goldens() {
  std::vector<Golden> out;
  const auto add = [&out](const char* name, auto change, bool near = true) {
    Golden golden{name, {}, near};
    change(golden.look);
    out.push_back(golden);
  };
  add("blocks", [](Look& l) { l.surface = Surface::Blocks; });
  add("linear", [](Look&) {});
  add("bicubic", [](Look& l) { l.surface = Surface::Bicubic; });
  add(
      "nearest", [](Look& l) { l.filter = Filter::Nearest; }, false);
  add(
      "bilinear", [](Look& l) { l.filter = Filter::Bilinear; }, false);
  add(
      "trilinear", [](Look& l) { l.filter = Filter::Trilinear; }, false);
  add(
      "anisotropic", [](Look& l) { l.max_anisotropy = 16; }, false);
  add("shadows", [](Look& l) {
    l.shadows = true;
    l.relief = 1;
    l.sun_height = 0.5;
  });
  add(
      "patch", [](Look& l) { l.no_data = NoData::Patch; }, false);
  add(
      "elevation", [](Look& l) { l.mode = Mode::Elevation; }, false);
  add(
      "quality", [](Look& l) { l.mode = Mode::Quality; }, false);
  add(
      "age", [](Look& l) { l.mode = Mode::Age; }, false);
  add("lateral", [](Look& l) {
    l.projectors = 3;
    l.relief = 0.2;
  });
  add(
      "level",
      [](Look& l) {
        l.mode = Mode::Level;
        l.relief = 0;
      },
      false);
  return out;
}

class Pictures : public test::GlTest {};

// A stored picture may differ by this much: rasterisers round differently, and an edge may fall on the other
// side of a pixel.
constexpr int kLargest = 6;      // of 255, in any channel ...
constexpr double kShare = 0.01;  // ... but for this share of the pixels
// OVERFLY_WRITE_GOLDEN=1 writes the pictures instead, for a person to look at before they are committed.
TEST_F(Pictures, LookAsTheyDid) {
  if (!context().info().software) GTEST_SKIP() << "the stored pictures are llvmpipe's";
  const std::filesystem::path folder = std::filesystem::path(OVERFLY_SOURCE_DIR) / "tests/data/preview";
  const bool write = std::getenv("OVERFLY_WRITE_GOLDEN") != nullptr;
  SyntheticMap map({}, test::holedHeight);
  RamCache ram(map);
  // Walls of bricks, another colour from each photograph.
  test::PhotoRing photos(
      {viewOf(map, 130, 400, 26, 35, -35), viewOf(map, 270, 400, 26, -35, -35),
       viewOf(map, 200, 390, 40, 0, -40)},
      [](double u, double v, std::size_t index) {
        const int row = static_cast<int>(60 * v);
        const double along = 40 * u + 0.5 * (row % 2);
        const bool joint = 60 * v - row < 0.15 || along - std::floor(along) < 0.1;
        const auto shade = static_cast<std::uint8_t>(90 + 50 * index);
        return joint ? test::PhotoRing::Rgb{225, 225, 215} : test::PhotoRing::Rgb{230, shade, 60};
      });
  Previewer previewer(context(), ram);
  previewer.setProjectors(&photos);
  for (const Golden& golden : goldens()) {
    const View view = golden.near ? viewOf(map, 200, 330, 14, 0, -22) : viewOf(map, 190, 520, 45, 0, -30);
    const auto frame = previewer.drawSettled(view, golden.look);
    ASSERT_TRUE(frame.has_value()) << golden.name << ": " << frame.error().message;
    cv::Mat drawn(view.height, view.width, CV_8UC3);
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x) {
        const std::uint8_t* p = &frame->picture.rgba[static_cast<std::size_t>(4 * (y * view.width + x))];
        drawn.at<cv::Vec3b>(y, x) = {p[2], p[1], p[0]};
      }
    const std::string file = (folder / (std::string(golden.name) + ".png")).string();
    if (write) {
      std::filesystem::create_directories(folder);
      ASSERT_TRUE(cv::imwrite(file, drawn));
      continue;
    }
    const cv::Mat stored = cv::imread(file, cv::IMREAD_COLOR);
    ASSERT_EQ(stored.size(), drawn.size()) << file;
    int beyond = 0;
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x) {
        int largest = 0;
        for (int c = 0; c < 3; ++c)
          largest = std::max(largest, std::abs(drawn.at<cv::Vec3b>(y, x)[c] - stored.at<cv::Vec3b>(y, x)[c]));
        beyond += largest > kLargest ? 1 : 0;
      }
    EXPECT_LE(beyond, kShare * view.width * view.height) << golden.name;
  }
}

// What a view calls for depends on the ground's height, which is a guess until the first tiles are there.
TEST_F(Pictures, TheFirstOfAMapIsAsFineAsTheNext) {
  SyntheticMap map({}, test::townHeight);
  RamCache ram(map);
  Previewer previewer(context(), ram);
  const View view = viewOf(map, 200, 330, 14, 0, -22);
  const auto first = previewer.drawSettled(view, {});
  ASSERT_TRUE(first.has_value()) << first.error().message;
  const auto second = previewer.drawSettled(view, {});
  ASSERT_TRUE(second.has_value()) << second.error().message;
  EXPECT_EQ(first->picture.rgba, second->picture.rgba);
}

TEST_F(Pictures, ThePlaceUnderAPixelIsWhereTheRayMeetsTheGround) {
  SyntheticMap map({}, test::townHeight);
  RamCache ram(map);
  Previewer previewer(context(), ram);
  const View view = viewOf(map, 200, 300, 25, 20, -35);
  Look look;
  look.level_of_detail = false;
  const auto frame = previewer.drawSettled(view, look, true);
  ASSERT_TRUE(frame.has_value()) << frame.error().message;
  const geo::LocalFrame local(view.position);
  for (int y = 5; y < view.height; y += 20) {
    for (int x = 5; x < view.width; x += 20) {
      const RayHit& hit = frame->picture.hits[static_cast<std::size_t>(y * view.width + x)];
      if (!hit.found) continue;
      const Eigen::Vector3d there = local.enuFromEcef(geo::ecefFromGeodetic(previewer.placeOf(hit)));
      EXPECT_LT((there - hit.t * view.direction(x + 0.5, y + 0.5)).norm(), 0.005);
    }
  }
}

// With levels of detail, what is hit lies within the cell that a pixel covers there: over hills, where a
// cell's mean is its middle. (At a wall the mean of a coarse cell lies between its top and foot by design.)
TEST_F(Pictures, LevelsOfDetailMoveTheSurfaceByLessThanThePixelsCell) {
  const auto hills = [](int x, int y) {
    return static_cast<float>(447 + 6 * std::sin(x * 0.011) * std::cos(y * 0.013) +
                              0.8 * std::sin(x * 0.05 + y * 0.07));
  };
  SyntheticMap map({}, hills);
  RamCache ram(map);
  Previewer previewer(context(), ram);
  View view = viewOf(map, 190, 700, 60, 0, -28);
  view.width = 96;
  view.height = 64;
  const auto frame = previewer.drawSettled(view, {}, true);
  ASSERT_TRUE(frame.has_value()) << frame.error().message;
  const HeightGrid grid = HeightGrid::load(previewer.cache()->domain(), map, 0).value();
  const ReferenceCaster reference(grid, Surface::Linear);
  int compared = 0, beyond = 0, coarse = 0;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const RayHit& hit = frame->picture.hits[static_cast<std::size_t>(y * view.width + x)];
      const auto expected = reference.cast(*previewer.frame(), view.direction(x + 0.5, y + 0.5), 60000);
      if (!hit.found || !expected) continue;
      ++compared;
      coarse += hit.level > 0 ? 1 : 0;
      const double cell = std::max(hit.t * pixelAngle(view), previewer.cache()->domain().texelSize());
      beyond += std::abs(hit.height_m - expected->height_m) > cell ? 1 : 0;
    }
  }
  EXPECT_GT(coarse, compared / 2);
  EXPECT_LE(beyond, compared / 100) << "of " << compared;
}

// At walls: what is hit lies no farther from the exact surface than the cell that a pixel covers is wide. A
// wall is part of the surface from its foot to its top, so all heights between those within a cell's width
// count.
TEST_F(Pictures, LevelsOfDetailMoveWallsByLessThanThePixelsCell) {
  SyntheticMap map({}, test::townHeight);
  RamCache ram(map);
  Previewer previewer(context(), ram);
  View view = viewOf(map, 190, 560, 40, 0, -28);
  view.width = 96;
  view.height = 64;
  const auto frame = previewer.drawSettled(view, {}, true);
  ASSERT_TRUE(frame.has_value()) << frame.error().message;
  const Domain& domain = previewer.cache()->domain();
  const HeightGrid grid = HeightGrid::load(domain, map, 0).value();
  int compared = 0, walls = 0, beyond = 0;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const RayHit& hit = frame->picture.hits[static_cast<std::size_t>(y * view.width + x)];
      if (!hit.found || hit.level == 0) continue;
      const double cell = std::max(hit.t * pixelAngle(view), domain.texelSize());
      const int reach = static_cast<int>(std::ceil(cell / domain.texelSize()));
      const Eigen::Vector2i at = hit.texel.array().floor().cast<int>();
      double low = 1e9, high = -1e9;
      bool edge = false;  // of the map: a wall from below everything
      for (int v = -2 * reach; v <= 2 * reach; ++v) {
        for (int u = -2 * reach; u <= 2 * reach; ++u) {
          edge = edge || !grid.valid(at.x() + u, at.y() + v);
          if (edge || std::abs(u) > reach || std::abs(v) > reach) continue;
          low = std::min(low, static_cast<double>(grid.at(at.x() + u, at.y() + v)));
          high = std::max(high, static_cast<double>(grid.at(at.x() + u, at.y() + v)));
        }
      }
      if (edge) continue;
      ++compared;
      walls += high - low > 3 ? 1 : 0;
      beyond += hit.height_m < low - cell || hit.height_m > high + cell ? 1 : 0;
    }
  }
  std::printf("%d pixels, %d of them beside walls: %d farther off than a cell\n", compared, walls, beyond);
  EXPECT_GT(walls, compared / 4);
  EXPECT_LE(beyond, compared / 1000);
}

// Fifty tiles a second get other heights while the camera flies and then rests: no picture has a hole, no
// update passes its budget, where the camera rests no pixel's level drops, and the picture is soon whole
// again.
class ChangingMap : public Pictures, public ::testing::WithParamInterface<bool> {};
TEST_P(ChangingMap, HasNoHolesAndDoesNotFlicker) {
  SyntheticMap map({}, test::townHeight);
  RamCache ram(map), all(map);
  Previewer previewer(context(), ram), calm(context(), all);
  View view = viewOf(map, 60, 330, 20, 60, -30);
  view.width = 80;
  view.height = 48;
  ASSERT_TRUE(previewer.drawSettled(view, {}, true).has_value());
  ClipCache::Budget budget;
  budget.uploads = 3;
  budget.aside = GetParam();
  std::vector<RayHit> before;
  std::size_t missing = 0, pixels = 0;
  constexpr int kFrames = 50;  // at 25 a second: two seconds
  for (int i = 0; i < kFrames; ++i) {
    const bool flying = i < kFrames / 2;
    if (flying) view.position = map.place(60 + 8 * i, 330 - 3 * i, 467);
    for (int k = 0; k < 2; ++k) {
      const int n = 2 * i + k;
      const auto changed = [n](int x, int y) {
        return test::townHeight(x, y) + 0.1F * static_cast<float>(n % 7);
      };
      map.change(n % 6, (n / 6 + n) % 6, changed, n % 5 != 0);
    }
    ASSERT_TRUE(ram.poll().has_value());
    ASSERT_TRUE(all.poll().has_value());
    for (int k = 0; k < 4; ++k) ram.loadNext();  // a disk that can hardly follow
    const auto frame = previewer.draw(view, {}, budget, true);
    ASSERT_TRUE(frame.has_value()) << frame.error().message;
    EXPECT_LE(frame->update.uploads, 3);
    // The same view with every tile at hand.
    const auto whole = calm.drawSettled(view, {}, true);
    ASSERT_TRUE(whole.has_value()) << whole.error().message;
    const auto at = [&view](int x, int y) { return static_cast<std::size_t>(y * view.width + x); };
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const RayHit& hit = frame->picture.hits[at(x, y)];
        if (!flying && !before.empty() && before[at(x, y)].found && hit.found) {
          // What lies farther off after a change of height may be coarser by right.
          const double lod = std::log2(hit.t * levelsPerMetre(view, previewer.cache()->domain()));
          ASSERT_LE(hit.level, std::max(before[at(x, y)].level, static_cast<int>(std::floor(lod + 1e-3))))
              << "frame " << i << " pixel " << x << ", " << y;
        }
        ++pixels;
        if (hit.found) continue;
        missing += whole->picture.hits[at(x, y)].found ? 1 : 0;
        // Along an edge a coarser level's mean, or an older height, may let a ray pass; within the ground
        // none.
        bool inside = true;
        for (int v = std::max(y - 2, 0); v <= std::min(y + 2, view.height - 1); ++v)
          for (int u = std::max(x - 2, 0); u <= std::min(x + 2, view.width - 1); ++u)
            inside = inside && whole->picture.hits[at(u, v)].found;
        EXPECT_FALSE(inside) << "frame " << i << " pixel " << x << ", " << y;
      }
    }
    before = flying ? std::vector<RayHit>{} : frame->picture.hits;
  }
  EXPECT_LE(missing, pixels / 500);
  int frames = 0;
  for (bool settled = false; !settled && frames < 200; ++frames) {
    ram.loadDue();
    if (budget.aside) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    const auto frame = previewer.draw(view, {}, budget);
    ASSERT_TRUE(frame.has_value()) << frame.error().message;
    settled = frame->update.settled();
  }
  std::printf("missing along edges: %zu of %zu pixels; whole again after %d frames\n", missing, pixels,
              frames);
  EXPECT_LT(frames, 50);
}
INSTANTIATE_TEST_SUITE_P(ImagesMade, ChangingMap, ::testing::Bool(),
                         [](const auto& aside) { return aside.param ? "Aside" : "AtOnce"; });

}  // namespace
}  // namespace overfly::preview
