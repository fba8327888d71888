// Level-0 tile updates per second while frames arrive, in the setting of the GRAPP paper's figure 5: tiles of
// 256^2 and 512^2 texels, 20 texels a metre, frames of 4000 x 3000 pixels from 50 m above flat ground. A
// frame is decoded, laid onto the plane, its tiles and all their parents are coded and committed to a map on
// the disk of the temporary folder before the next but two is taken. The paper: 427.59 and 150.57 updates a
// second, on an i7 of four cores with a GeForce 470, in memory.
//
// The paper's frames come unencoded over a network: `raw` is that case. `jpeg` is a camera's.
#include <benchmark/benchmark.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>

#include "capture/geo/footprint.h"
#include "capture/image_decode.h"
#include "tests/bench/clipmap/ground.h"
#include "tiling/planar/planar_map.h"

namespace overfly::tiling {
namespace {

constexpr double kAbove_m = 50;
constexpr int kLines = 5, kPerLine = 12;
// With 24 mm (35 mm equivalent) the frame shows 75 m x 56 m: half of it is new in the next, 30 % beside.
constexpr double kForward_m = 28, kSide_m = 52;
// Where a Web Mercator texel of zoom 21 is 5 cm.
const geo::Geodetic kPlace{std::acos(0.05 * 2097152 * 256 / geo::TileLattice::kCellMetres), geo::radians(7.6),
                           0};

std::vector<capture::Image> pictures(bool jpeg) {
  std::vector<capture::Image> made;
  for (std::uint32_t seed = 1; seed <= 3; ++seed) {
    capture::Image raw;
    raw.format = capture::PixelFormat::Rgb8;
    raw.width = 4000;
    raw.height = 3000;
    raw.stride = 3 * raw.width;
    raw.bytes = paintGround(raw.width, raw.height, seed);
    made.push_back(jpeg ? *capture::encodeJpeg(raw, 92) : std::move(raw));
  }
  return made;
}

std::vector<capture::FramePtr> flight(const std::vector<capture::Image>& pictures) {
  const geo::LocalFrame local(kPlace);
  std::vector<capture::FramePtr> frames;
  for (int line = 0; line < kLines; ++line)
    for (int i = 0; i < kPerLine; ++i) {
      auto frame = std::make_shared<capture::Frame>();
      frame->name = std::to_string(frames.size());
      frame->camera.width = 4000;
      frame->camera.height = 3000;
      frame->camera.fx = frame->camera.fy = 2667;
      frame->camera.cx = 2000;
      frame->camera.cy = 1500;
      const int along = line % 2 == 0 ? i : kPerLine - 1 - i;
      capture::Pose pose;
      pose.position_in_ecef = local.ecefFromEnu({kSide_m * line, kForward_m * along, kAbove_m});
      const geo::LocalFrame there(geo::geodeticFromEcef(pose.position_in_ecef));
      pose.ecef_from_camera = Eigen::Quaterniond(there.enuFromEcefRotation()).conjugate() *
                              geo::enuFromCamera(line % 2 == 0 ? 0 : geo::radians(180), geo::radians(-90), 0);
      frame->pose = pose;
      frame->image = pictures[frames.size() % pictures.size()];
      frames.push_back(std::move(frame));
    }
  return frames;
}

double cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

void grapp(benchmark::State& state) {
  const int tile_size = static_cast<int>(state.range(0));
  const bool jpeg = state.range(1) != 0;
  const auto frames = flight(pictures(jpeg));
  const auto folder = std::filesystem::temp_directory_path() / ("overfly-grapp." + std::to_string(getpid()));
  PlanarStatistics sum;
  double cpu = 0;
  std::size_t frame_bytes = 0;
  for (const auto& frame : frames) frame_bytes += frame->image.bytes.size();
  for (auto _ : state) {
    state.PauseTiming();
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    MapMeta meta;
    meta.tile_size = tile_size;
    meta.base_zoom = tile_size == 256 ? 21 : 20;
    auto store = MapStore::create(folder / "map.overfly", meta);
    if (!store) return state.SkipWithError(store.error().message.c_str());
    auto map = PlanarMap::create(std::move(*store), {});
    state.ResumeTiming();
    const double before = cpu_s();
    for (std::size_t i = 0; i < frames.size(); ++i)
      if (auto ok = (*map)->addFrame(i, frames[i],
                                     [&frames, i]() -> Result<capture::FramePtr> { return frames[i]; });
          !ok)
        return state.SkipWithError(ok.error().message.c_str());
    if (auto ok = (*map)->finish(); !ok) return state.SkipWithError(ok.error().message.c_str());
    cpu += cpu_s() - before;
    state.PauseTiming();
    const PlanarStatistics& s = (*map)->statistics();
    sum.tiles += s.tiles;
    sum.coded += s.coded;
    sum.images_loaded += s.images_loaded;
    sum.parents += s.parents;
    sum.commits += s.commits;
    sum.bytes += s.bytes;
    sum.decode_s += s.decode_s;
    sum.plan_s += s.plan_s;
    sum.project_s += s.project_s;
    sum.encode_s += s.encode_s;
    sum.parents_s += s.parents_s;
    map->reset();
    std::filesystem::remove_all(folder);
    state.ResumeTiming();
  }
  const auto tiles = static_cast<double>(sum.tiles);
  const auto rate = [](double count) { return benchmark::Counter(count, benchmark::Counter::kIsRate); };
  const auto perTile = [tiles](double seconds) { return 1000 * seconds / tiles; };
  state.counters["updates/s"] = rate(tiles);
  state.counters["paper"] = tile_size == 256 ? 427.59 : 150.57;
  state.counters["coded/s"] = rate(static_cast<double>(sum.coded));
  state.counters["decoded/frame"] =
      static_cast<double>(sum.images_loaded) /
      static_cast<double>(frames.size() * static_cast<std::size_t>(state.iterations()));
  state.counters["parents/s"] = rate(static_cast<double>(sum.parents));
  state.counters["frames/s"] =
      rate(static_cast<double>(frames.size()) * static_cast<double>(state.iterations()));
  state.counters["frame_MB"] = 1e-6 * static_cast<double>(frame_bytes) / static_cast<double>(frames.size());
  state.counters["tiles/commit"] =
      static_cast<double>(sum.coded + sum.parents) / static_cast<double>(sum.commits);
  state.counters["kB/tile"] =
      1e-3 * static_cast<double>(sum.bytes) / static_cast<double>(sum.coded + sum.parents);
  // CPU milliseconds per level-0 update, all threads.
  state.counters["rectify_ms"] = perTile(sum.decode_s);
  state.counters["project_ms"] = perTile(sum.plan_s + sum.project_s);
  state.counters["encode_ms"] = perTile(sum.encode_s);
  state.counters["parents_ms"] = perTile(sum.parents_s);
  state.counters["commit_ms"] =
      perTile(cpu - sum.decode_s - sum.plan_s - sum.project_s - sum.encode_s - sum.parents_s);
  state.counters["cpu_ms"] = perTile(cpu);
}
BENCHMARK(grapp)
    ->ArgNames({"tile", "jpeg"})
    ->Args({256, 0})
    ->Args({256, 1})
    ->Args({512, 0})
    ->Args({512, 1})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace overfly::tiling
