#include <cmath>
#include <cstdlib>
#include <string>

#include "daemon/link/detail/coverage.h"

// Any bytes as a planned area: refused with a reason, or rings within the world that can be drawn.
//   build/fuzz/tests/fuzz/plan/fuzz_plan -max_total_time=60 tests/fuzz/plan/corpus
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace overfly;
  static const auto lattice = geo::TileLattice::webMercator();
  const auto area = link::parsePlan({reinterpret_cast<const char*>(data), size}, lattice);
  if (!area) {
    if (area.error().message.empty()) std::abort();
    return 0;
  }
  tiling::PlaneBox box{1e9, 1e9, -1e9, -1e9};
  for (const auto& ring : area->rings) {
    if (ring.size() < 3) std::abort();
    for (const auto& point : ring) {
      if (!std::isfinite(point.x()) || !std::isfinite(point.y())) std::abort();
      box = {std::min(box.west, point.x()), std::min(box.north, point.y()), std::max(box.east, point.x()),
             std::max(box.south, point.y())};
    }
  }
  const auto grid = link::countViews(box, 24, 16, {});
  const auto inside = link::insideArea(*area, grid);
  for (const auto& outline : link::outlines(inside, 24, 16))
    if (outline.outer.size() < 4) std::abort();
  return 0;
}
