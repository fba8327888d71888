#include "daemon/tradeoff/preview_trials.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <set>

#include "render/preview/previewer.h"
#include "tiling/clipmap/parent.h"

namespace overfly::tradeoff {
namespace {

using preview::Filter;
using preview::Look;
using preview::Picture;
using preview::Surface;
using preview::View;

constexpr double kPitch = -0.7, kFov = 1.0471975512;  // radians

// A map's whole pyramid in memory.
class MapInMemory final : public preview::TileSource {
 public:
  MapInMemory(const std::map<geo::TileKey, tiling::Tile>& tiles, const tiling::MapGround& ground,
              int tile_size) {
    extent_.lattice = ground.lattice;
    extent_.tile_size = tile_size;
    extent_.finest_zoom = ground.base_zoom;
    extent_.min = {INFINITY, INFINITY};
    extent_.max = {-INFINITY, -INFINITY};
    std::set<geo::TileKey> level;
    std::map<geo::TileKey, tiling::Tile> parents;
    for (const auto& [key, tile] : tiles) {
      extent_.min = extent_.min.cwiseMin(geo::TileLattice::planeOf(key, 0, 0));
      extent_.max = extent_.max.cwiseMax(geo::TileLattice::planeOf(key, 1, 1));
      add(tile);
      level.insert(key);
    }
    const auto find = [&](const geo::TileKey& key) -> const tiling::Tile* {
      if (const auto it = tiles.find(key); it != tiles.end()) return &it->second;
      const auto it = parents.find(key);
      return it == parents.end() ? nullptr : &it->second;
    };
    while (spread(level) > 1 && level.begin()->zoom > 0) {
      std::set<geo::TileKey> next;
      for (const geo::TileKey& key : level) next.insert(geo::parentOf(key));
      for (const geo::TileKey& key : next) {
        std::array<const tiling::Tile*, 4> children{};
        for (int i = 0; i < 4; ++i) children[static_cast<std::size_t>(i)] = find(geo::childOf(key, i));
        const auto made = parents.insert_or_assign(key, tiling::makeParent(key, children)).first;
        add(made->second);
      }
      level = std::move(next);
    }
  }

  Result<preview::MapExtent> extent() override { return extent_; }
  Result<preview::SourceTilePtr> load(const geo::TileKey& key) override {
    const auto it = tiles_.find(key);
    if (it == tiles_.end()) return fail(ErrorCode::NotFound, "no such tile");
    return it->second;
  }
  Result<std::vector<geo::TileKey>> changes(std::uint64_t& since) override {
    since = 1;
    return std::vector<geo::TileKey>{};
  }

 private:
  void add(const tiling::Tile& tile) {
    auto out = std::make_shared<preview::SourceTile>();
    out->key = tile.key;
    out->revision = 1;
    out->size = tile.size;
    out->color = tile.color;
    out->elevation = tile.elevation;
    out->elevation_max = tiling::elevationMax(tile);
    out->confidence = tile.confidence;
    tiles_.insert_or_assign(tile.key, std::move(out));
  }
  static std::int64_t spread(const std::set<geo::TileKey>& keys) {
    std::int64_t west = INT64_MAX, east = INT64_MIN, north = INT64_MAX, south = INT64_MIN;
    for (const geo::TileKey& key : keys) {
      west = std::min<std::int64_t>(west, key.x);
      east = std::max<std::int64_t>(east, key.x);
      north = std::min<std::int64_t>(north, key.y);
      south = std::max<std::int64_t>(south, key.y);
    }
    return std::max(east - west, south - north);
  }

  preview::MapExtent extent_;
  std::map<geo::TileKey, preview::SourceTilePtr> tiles_;
};

// The middle of the map from the south, near enough that level 0 is what a pixel shows in the foreground.
Result<View> obliqueView(const preview::MapExtent& extent, double ground_m, int width) {
  auto domain = preview::Domain::create(extent);
  if (!domain) return tl::unexpected(domain.error());
  View view;
  view.fov = kFov;
  view.pitch = kPitch;
  view.width = width;
  view.height = width * 9 / 16;
  const double across = (domain->maxTexel() - domain->minTexel()).minCoeff() * domain->texelSize();
  const double away = 0.5 * across / std::tan(kFov / 2);
  const Eigen::Vector2d middle = (domain->minTexel() + domain->maxTexel()) / 2;
  const double south = away * std::cos(kPitch) / domain->texelSize();
  view.position =
      domain->lattice().geodeticFromPlane(domain->planeFromTexel(middle + Eigen::Vector2d(0, south)));
  view.position.height_m = ground_m + away * std::sin(-kPitch);
  return view;
}

// The mean of `factor` x `factor` pixels each, or each pixel repeated: nothing a viewer could not do.
std::vector<std::uint8_t> resized(const Picture& picture, int width, int height) {
  std::vector<std::uint8_t> out(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  const double sx = static_cast<double>(picture.width) / width;
  const double sy = static_cast<double>(picture.height) / height;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const int x0 = static_cast<int>(x * sx), y0 = static_cast<int>(y * sy);
      const int nx = std::max(1, static_cast<int>(sx)), ny = std::max(1, static_cast<int>(sy));
      std::array<int, 4> sum{};
      for (int v = y0; v < y0 + ny; ++v)
        for (int u = x0; u < x0 + nx; ++u)
          for (std::size_t c = 0; c < 4; ++c)
            sum[c] +=
                picture.rgba[4 * (static_cast<std::size_t>(v) * static_cast<std::size_t>(picture.width) +
                                  static_cast<std::size_t>(u)) +
                             c];
      for (std::size_t c = 0; c < 4; ++c)
        out[4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(x)) +
            c] = static_cast<std::uint8_t>((sum[c] + nx * ny / 2) / (nx * ny));
    }
  return out;
}

double meanDifference(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); i += 4)
    for (std::size_t c = 0; c < 3; ++c)
      sum += std::abs(static_cast<int>(a[i + c]) - static_cast<int>(b[i + c]));
  return a.empty() ? 0 : sum / (0.75 * static_cast<double>(a.size()));
}

struct Setting {
  std::string axis, text;
  bool is_default = false;
  Look look;
  int divisor = 1;  // of the picture's resolution
};

std::vector<Setting> settings() {
  std::vector<Setting> list;
  const auto add = [&](const std::string& axis, const std::string& text,
                       const std::function<void(Setting&)>& change) {
    Setting setting{axis, text, axis == "default", {}, 1};
    change(setting);
    list.push_back(std::move(setting));
  };
  add("default", "linear surface, 4 anisotropic samples", [](Setting&) {});
  add("surface", "blocks", [](Setting& s) { s.look.surface = Surface::Blocks; });
  add("surface", "bicubic surface", [](Setting& s) { s.look.surface = Surface::Bicubic; });
  add("filter", "nearest texel", [](Setting& s) { s.look.filter = Filter::Nearest; });
  add("filter", "bilinear", [](Setting& s) { s.look.filter = Filter::Bilinear; });
  add("filter", "trilinear", [](Setting& s) { s.look.filter = Filter::Trilinear; });
  for (const int samples : {1, 2, 8, 16})
    add("samples", fmt::format("{} anisotropic samples", samples),
        [samples](Setting& s) { s.look.max_anisotropy = samples; });
  add("level of detail", "finest level everywhere", [](Setting& s) { s.look.level_of_detail = false; });
  for (const int divisor : {2, 4})
    add("resolution", fmt::format("resolution 1/{}", divisor),
        [divisor](Setting& s) { s.divisor = divisor; });
  add("combined", "blocks, nearest texel, resolution 1/4", [](Setting& s) {
    s.look.surface = Surface::Blocks;
    s.look.filter = Filter::Nearest;
    s.divisor = 4;
  });
  add("combined", "bicubic, 16 samples, finest level", [](Setting& s) {
    s.look.surface = Surface::Bicubic;
    s.look.max_anisotropy = 16;
    s.look.level_of_detail = false;
  });
  return list;
}

}  // namespace

Result<std::vector<Trial>> tryPreview(gl::Context& context, const std::map<geo::TileKey, tiling::Tile>& tiles,
                                      const tiling::MapGround& ground, int tile_size, int width,
                                      int repeats) {
  if (tiles.empty()) return fail(ErrorCode::BadInput, "no tile to draw");
  MapInMemory source(tiles, ground, tile_size);
  preview::RamCache ram(source, {.budget_bytes = std::size_t{1} << 30});
  preview::Previewer previewer(context, ram, {.gpu_bytes = std::size_t{512} << 20});
  const preview::MapExtent extent = *source.extent();
  auto view = obliqueView(extent, ground.height_m, width);
  if (!view) return tl::unexpected(view.error());

  Look best;
  best.surface = Surface::Bicubic;
  best.max_anisotropy = 16;
  best.level_of_detail = false;
  View doubled = *view;
  doubled.width *= 2;
  doubled.height *= 2;
  auto drawn = previewer.drawSettled(doubled, best);
  if (!drawn) return tl::unexpected(drawn.error());
  const std::vector<std::uint8_t> reference = resized(drawn->picture, view->width, view->height);

  std::vector<Trial> trials;
  for (const Setting& setting : settings()) {
    View at = *view;
    at.width /= setting.divisor;
    at.height /= setting.divisor;
    Trial trial{.part = "preview",
                .axis = setting.axis,
                .setting = setting.text,
                .is_default = setting.is_default,
                .error_name = "mean difference, 0 to 255"};
    std::vector<double> processor, wall;
    for (int run = 0; run <= repeats; ++run) {  // the first compiles the shader and loads the tiles
      const Elapsed elapsed = elapsedOf([&] { drawn = previewer.drawSettled(at, setting.look); });
      if (!drawn) return tl::unexpected(drawn.error());
      if (run == 0) continue;
      processor.push_back(elapsed.processor_ms);
      wall.push_back(elapsed.wall_ms);
    }
    trial.processor = timingOf(processor);
    trial.wall = timingOf(wall);
    trial.error = meanDifference(resized(drawn->picture, view->width, view->height), reference);
    trials.push_back(std::move(trial));
  }
  markFront(trials);
  return trials;
}

}  // namespace overfly::tradeoff
