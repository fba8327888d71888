// What a tile costs before any pixel is touched: its frame, its views; and a frame's marks.
#include <benchmark/benchmark.h>

#include "capture/geo/tile_frame.h"
#include "tiling/index/frame_index.h"
#include "tiling/index/view_selection.h"

namespace overfly::tiling {
namespace {

void constructTileFrame(benchmark::State& state) {
  const auto lattice = state.range(0) == 0 ? geo::TileLattice::webMercator()
                                           : geo::TileLattice::local({geo::radians(48), geo::radians(9), 0});
  geo::TileKey key =
      geo::TileLattice::keyAt(*lattice.planeFromGeodetic(geo::radians(48), geo::radians(9)), 20);
  for (auto _ : state) {
    ++key.x;
    benchmark::DoNotOptimize(geo::TileFrame(lattice, key));
  }
}
BENCHMARK(constructTileFrame)->ArgName("local")->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);

// range(0) frames over one tile, 12 chosen.
void chooseViews(benchmark::State& state) {
  const auto lattice = geo::TileLattice::webMercator();
  const geo::Geodetic centre{geo::radians(48), geo::radians(9), 400};
  const geo::LocalFrame local(centre);
  capture::CameraModel camera;
  camera.width = 4000;
  camera.height = 3000;
  camera.fx = camera.fy = 3000;
  camera.cx = 2000;
  camera.cy = 1500;
  std::vector<IndexedFrame> frames;
  for (int i = 0; i < state.range(0); ++i) {
    const geo::Geodetic at =
        geo::geodeticFromEcef(local.ecefFromEnu({7.0 * (i % 7 - 3), 6.0 * (i / 7 % 7 - 3), 100}));
    capture::Pose pose;
    pose.position_in_ecef = geo::ecefFromGeodetic(at);
    pose.ecef_from_camera =
        Eigen::Quaterniond(Eigen::Matrix3d(geo::LocalFrame(at).enuFromEcefRotation().transpose())) *
        geo::enuFromCamera(0, -1.5708, 0);
    frames.push_back(
        makeIndexedFrame(static_cast<std::uint64_t>(i), camera, pose, 1, lattice, 0.5, 400).value());
  }
  std::vector<const IndexedFrame*> candidates;
  for (const IndexedFrame& frame : frames) candidates.push_back(&frame);
  const geo::TileKey key = geo::TileLattice::keyAt(frames[0].nadir, 20);
  for (auto _ : state) benchmark::DoNotOptimize(selectViews(candidates, lattice, key, 400));
}
BENCHMARK(chooseViews)->Arg(10)->Arg(50)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace overfly::tiling
