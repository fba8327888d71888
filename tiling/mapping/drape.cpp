#include "tiling/mapping/drape.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "capture/geo/geodetic.h"

namespace overfly::tiling {
namespace {

// Heights of tiles, kept while neighbours ask for them: rows of cells are gone through from north to south.
class Heights {
 public:
  explicit Heights(const DrapeSurface& surface) : surface_(surface) {}

  Result<const std::vector<float>*> of(const geo::TileKey& key) {
    if (const auto known = kept_.find(key); known != kept_.end()) return &known->second;
    auto read = surface_.heights(key);
    if (!read) return tl::unexpected(read.error());
    return &kept_.emplace(key, std::move(*read)).first->second;
  }
  void forgetAbove(std::int64_t y) {
    std::erase_if(kept_, [y](const auto& entry) { return entry.first.y < y; });
  }

 private:
  const DrapeSurface& surface_;
  std::map<geo::TileKey, std::vector<float>> kept_;
};

// All heights of the tiles right below the cameras, in order.
Result<std::vector<float>> heightsUnder(const capture::Flight& flight, const DrapeSurface& surface,
                                        Heights& heights) {
  std::vector<float> found;
  std::set<geo::TileKey> asked;
  for (std::size_t i = 0; i < flight.size(); ++i) {
    const auto& pose = flight.at(i).frame.pose;
    if (!pose) continue;
    const geo::Geodetic place = geo::geodeticFromEcef(pose->position_in_ecef);
    const auto plane = surface.lattice.planeFromGeodetic(place.lat, place.lon, surface.anchor_px);
    if (!plane) continue;
    const geo::TileKey key = geo::TileLattice::keyAt(*plane, surface.base_zoom);
    if (!asked.insert(key).second) continue;
    auto field = heights.of(key);
    if (!field) return tl::unexpected(field.error());
    for (const float h : **field)
      if (!std::isnan(h)) found.push_back(h);
  }
  if (found.empty())
    return fail(ErrorCode::BadInput,
                "the map has no heights below the flight's cameras: it shows another place");
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

Result<DrapeResult> drapeFlight(
    gl::Context& context, const capture::Flight& flight, const DrapeSurface& surface,
    const MapperOptions& options, const std::function<Result<void>(Tile&&)>& tile,
    const std::function<void(const std::string&, std::uint64_t, std::uint64_t)>& progress) {
  Heights heights(surface);
  auto under = heightsUnder(flight, surface, heights);
  if (!under) return tl::unexpected(under.error());
  MapGround ground;
  ground.lattice = surface.lattice;
  ground.base_zoom = surface.base_zoom;
  ground.anchor_px = surface.anchor_px;
  ground.height_m = static_cast<double>((*under)[under->size() / 2]);
  ground.min_height_m = static_cast<double>(under->front());
  ground.max_height_m = static_cast<double>(under->back());
  for (std::size_t i = 0; i < flight.size(); ++i)
    if (const auto& pose = flight.at(i).frame.pose) {
      const geo::Geodetic place = geo::geodeticFromEcef(pose->position_in_ecef);
      ground.texel_m = surface.lattice.texelSize(surface.base_zoom, place.lat, place.lon, options.tile_size);
      break;
    }
  ground.gsd_m = ground.texel_m;  // cells are tiles: coloured as fine as the map is

  auto created = Mapper::create(context, options);
  if (!created) return tl::unexpected(created.error());
  Mapper& mapper = **created;
  mapper.setGround(ground);
  DrapeResult result;
  std::set<geo::TileKey> cells;
  const auto report = [&](const std::string& stage, std::uint64_t done, std::uint64_t total) {
    if (progress) progress(stage, done, total);
  };
  for (std::size_t i = 0; i < flight.size(); ++i) {
    report("frames", i, flight.size());
    auto frame = flight.load(i);
    auto touched = frame ? mapper.addFrame(i, *frame, [&flight, i] { return flight.load(i); })
                         : Result<std::vector<geo::TileKey>>(tl::unexpected(frame.error()));
    if (!touched) {
      if (touched.error().code == ErrorCode::Unavailable) return tl::unexpected(touched.error());
      result.refused.push_back(flight.at(i).frame.name + ": " + touched.error().message);
      continue;
    }
    ++result.frames_used;
    cells.insert(touched->begin(), touched->end());
  }
  (void)mapper.balanceExposure();

  const std::vector<geo::TileKey> order = Mapper::rowByRow(cells);
  std::uint64_t done = 0;
  for (const geo::TileKey& cell : order) {
    report("tiles", done++, order.size());
    heights.forgetAbove(cell.y - 1);
    std::array<std::vector<float>, 9> around;
    const std::vector<geo::TileKey> keys = Mapper::neighboursOf(cell);
    for (std::size_t i = 0; i < keys.size(); ++i) {
      auto field = heights.of(keys[i]);
      if (!field) return tl::unexpected(field.error());
      around[i] = **field;
    }
    if (around[4].empty()) continue;
    auto tiles = mapper.colourOn(cell, around);
    if (!tiles) return tl::unexpected(tiles.error());
    for (Tile& made : *tiles)
      if (auto ok = tile(std::move(made)); !ok) return tl::unexpected(ok.error());
  }
  report("tiles", order.size(), order.size());
  return result;
}

}  // namespace overfly::tiling
