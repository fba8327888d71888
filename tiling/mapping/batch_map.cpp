#include "tiling/mapping/batch_map.h"

#include <algorithm>
#include <chrono>
#include <set>

#include "capture/reduced_frame.h"

namespace overfly::tiling {
namespace {

// Frames to settle the ground with: enough pairs for a median, spread over the flight.
constexpr std::size_t kGroundFrames = 12;

}  // namespace

Result<BatchResult> mapFlight(gl::Context& context, const capture::Flight& flight,
                              const BatchOptions& options, const BatchEvents& events) {
  const auto start = std::chrono::steady_clock::now();
  BatchResult result;
  auto created = Mapper::create(context, options.mapper);
  if (!created) return tl::unexpected(created.error());
  Mapper& mapper = **created;
  const auto progress = [&](const std::string& stage, std::uint64_t done, std::uint64_t total) {
    if (events.progress) events.progress(stage, done, total);
  };

  const auto load = [&flight, reduce = options.reduce](std::size_t i) -> Result<capture::FramePtr> {
    auto frame = flight.load(i);
    if (!frame || reduce == 1) return frame;
    return capture::reduced(**frame, reduce);
  };
  // Runs of neighbouring frames from four places of the flight.
  std::vector<std::size_t> posed;
  for (std::size_t i = 0; i < flight.size(); ++i)
    if (flight.at(i).frame.pose) posed.push_back(i);
  std::vector<Thumbnail> first;
  std::vector<capture::CameraModel> cameras;
  std::set<std::size_t> wanted;
  const std::size_t runs = std::max<std::size_t>(1, std::min<std::size_t>(4, posed.size() / 3));
  for (std::size_t run = 0; run < runs; ++run)
    for (std::size_t k = 0; k < kGroundFrames / runs; ++k)
      if (const std::size_t at = run * posed.size() / runs + k; at < posed.size()) wanted.insert(posed[at]);
  for (const std::size_t i : wanted) {
    auto frame = load(i);
    if (!frame) continue;
    auto thumbnail = mapper.thumbnailOf(i, *frame);
    if (!thumbnail) continue;
    first.push_back(std::move(*thumbnail));
    cameras.push_back((*frame)->camera);
  }
  GroundOptions settling = options.ground;
  settling.tile_size = options.mapper.tile_size;
  auto ground = Mapper::settleGround(first, cameras, options.lattice, settling);
  if (!ground && !settling.height_m && flight.info().ground_height_m) {
    settling.height_m = flight.info().ground_height_m;
    ground = Mapper::settleGround(first, cameras, options.lattice, settling);
  }
  if (!ground) return tl::unexpected(ground.error());
  mapper.setGround(*ground);
  result.ground = *ground;
  result.cell_zoom = mapper.cellZoom();
  if (events.ground)
    if (auto ok = events.ground(*ground); !ok) return tl::unexpected(ok.error());

  std::set<geo::TileKey> cells;
  for (std::size_t i = 0; i < flight.size(); ++i) {
    progress("frames", i, flight.size());
    auto frame = load(i);
    if (!frame) {
      result.refused.push_back(flight.at(i).frame.name + ": " + frame.error().message);
      continue;
    }
    auto touched = mapper.addFrame(i, *frame, [load, i] { return load(i); });
    if (!touched) {
      if (touched.error().code == ErrorCode::Unavailable) return tl::unexpected(touched.error());
      result.refused.push_back((*frame)->name + ": " + touched.error().message);
      continue;
    }
    ++result.frames_used;
    cells.insert(touched->begin(), touched->end());
    if (events.frame)
      if (auto ok = events.frame(i, flight.at(i), *mapper.index().find(i)); !ok)
        return tl::unexpected(ok.error());
  }
  // No cell has been coloured yet: none is to be made again.
  (void)mapper.balanceExposure();

  const std::vector<geo::TileKey> order = Mapper::rowByRow(cells);
  std::uint64_t done = 0;
  for (const geo::TileKey& cell : order) {
    progress("cells", done++, order.size());
    auto tiles = mapper.finishCell(cell);
    if (!tiles) return tl::unexpected(tiles.error());
    for (Tile& tile : *tiles)
      if (auto ok = events.tile(std::move(tile)); !ok) return tl::unexpected(ok.error());
  }
  progress("cells", order.size(), order.size());
  result.statistics = mapper.statistics();
  result.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

Result<MappedTiles> mapFlightToTiles(
    gl::Context& context, const capture::Flight& flight, const BatchOptions& options,
    const std::function<void(const std::string&, std::uint64_t, std::uint64_t)>& progress) {
  MappedTiles made;
  BatchEvents events;
  events.progress = progress;
  events.tile = [&](Tile&& tile) -> Result<void> {
    const geo::TileKey key = tile.key;
    made.tiles.insert_or_assign(key, std::move(tile));
    return {};
  };
  auto mapped = mapFlight(context, flight, options, events);
  if (!mapped) return tl::unexpected(mapped.error());
  made.result = std::move(*mapped);
  return made;
}

}  // namespace overfly::tiling
