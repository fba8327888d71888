#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "tests/stress/hard_case/hard_case.h"
#include "tiling/index/detail/convex.h"
#include "tiling/index/frame_index.h"

// Boxes without an area, and polygons whose edges lie on each other.
namespace overfly::tiling {
namespace {

TEST(Boxes, WithoutAnArea) {
  // Points, lines and boxes on a grid of whole metres, asked for with boxes on the same grid, so that most
  // of what meets only touches.
  std::mt19937 random(11);
  std::uniform_int_distribution<int> coordinate(0, 12), length(0, 1);
  const auto corner = [&] {
    return Eigen::Vector3d(coordinate(random), coordinate(random), coordinate(random));
  };
  FrameIndex index(geo::TileLattice::webMercator());
  std::vector<IndexedFrame> frames;
  for (std::uint64_t id = 0; id < 2000; ++id) {
    IndexedFrame frame;
    frame.id = id;
    frame.near_vertical = false;
    const Eigen::Vector3d at = corner();
    frame.pyramid_in_ecef = {at, at + Eigen::Vector3d(length(random), length(random), 0)};
    frames.push_back(frame);
    index.insert(frame);
  }
  double mistaken = 0;
  for (int round = 0; round < 2000; ++round) {
    const Eigen::Vector3d at = corner();
    const geo::Box3 box{at, at + Eigen::Vector3d(length(random), 0, length(random))};
    std::vector<std::uint64_t> expected, found;
    for (const IndexedFrame& frame : frames)
      if ((frame.pyramid_in_ecef.min.array() <= box.max.array()).all() &&
          (frame.pyramid_in_ecef.max.array() >= box.min.array()).all())
        expected.push_back(frame.id);
    for (const IndexedFrame* frame : index.framesInBox(box)) found.push_back(frame->id);
    mistaken += found == expected ? 0 : 1;
  }
  test::expectAtMost("index/zero-area", "queries with another answer than looking at each box", mistaken, 0);
}

TEST(Polygons, ThatTouch) {
  // A square with more corners on its edges, turning either way, against another a quarter of a side off.
  const auto square = [](double x, double y, int parts, bool reversed) {
    detail::Polygon out;
    const Eigen::Vector2d corners[] = {{x, y}, {x + 1, y}, {x + 1, y + 1}, {x, y + 1}};
    for (int side = 0; side < 4; ++side)
      for (int i = 0; i < parts; ++i)
        out.push_back(corners[side] + (corners[(side + 1) % 4] - corners[side]) * i / parts);
    if (reversed) std::reverse(out.begin(), out.end());
    return out;
  };
  double worst = 0;
  for (int i = -5; i <= 5; ++i)
    for (int j = -5; j <= 5; ++j)
      for (const int parts : {1, 4})
        for (const bool reversed : {false, true}) {
          const double dx = 0.25 * i, dy = 0.25 * j;
          const double expected = std::max(0.0, 1 - std::abs(dx)) * std::max(0.0, 1 - std::abs(dy));
          const auto met =
              detail::intersection(square(dx, dy, parts, reversed), square(0, 0, 5 - parts, false));
          worst = std::max(worst, std::abs(std::abs(detail::area(met)) - expected));
        }
  test::expectAtMost("index/clipping", "area of the intersection off", worst, 1e-12);
}

}  // namespace
}  // namespace overfly::tiling
