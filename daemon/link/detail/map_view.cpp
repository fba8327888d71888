#include "daemon/link/detail/map_view.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "daemon/link/detail/decode.h"
#include "daemon/link/detail/resample.h"

namespace overfly::link {
namespace {

constexpr std::size_t kRecentHeights = 24;

}  // namespace

std::uint64_t Composition::revision() const {
  std::uint64_t newest = 0;
  for (const auto& piece : pieces) newest = std::max(newest, piece.revision);
  return newest;
}

Result<std::unique_ptr<MapView>> MapView::open(const std::filesystem::path& path, int overzoom) {
  auto reader = tiling::MapReader::open(path);
  if (!reader) return tl::unexpected(reader.error());
  auto meta = reader->meta();
  if (!meta) return tl::unexpected(meta.error());
  auto lattice = geo::TileLattice::parse(meta->lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  if (meta->tile_size < kLinkTile || !std::has_single_bit(static_cast<unsigned>(meta->tile_size)))
    return fail(ErrorCode::Unsupported, "the link serves maps with tiles of 256, 512, ... texels");
  return std::unique_ptr<MapView>(new MapView(std::move(*reader), std::move(*meta), *lattice, overzoom));
}

MapView::MapView(tiling::MapReader reader, tiling::MapMeta meta, geo::TileLattice lattice, int overzoom)
    : reader_(std::move(reader)),
      meta_(std::move(meta)),
      lattice_(lattice),
      overzoom_(overzoom),
      shift_(std::countr_zero(static_cast<unsigned>(meta_.tile_size / kLinkTile))) {}

std::optional<Extent> MapView::extent(tiling::Layer layer) const {
  const auto bounds = reader_.bounds(layer);
  const auto zooms = reader_.zoomRange(layer);
  if (!bounds || !zooms) return std::nullopt;
  Extent out;
  const auto nw = lattice_.geodeticFromPlane({bounds->west, bounds->north});
  const auto se = lattice_.geodeticFromPlane({bounds->east, bounds->south});
  out.box = {geo::degrees(nw.lon), geo::degrees(se.lat), geo::degrees(se.lon), geo::degrees(nw.lat)};
  out.min_zoom = zooms->first + shift_;
  out.max_zoom = zooms->second + shift_;
  return out;
}

// The store's x continues over the antimeridian; the link's does not.
std::int64_t MapView::unwrapped(std::int64_t x, int zoom, const tiling::PlaneBox& bounds) const {
  if (bounds.west >= 0 && bounds.east <= 1) return x;
  const auto side = std::int64_t{1} << zoom;
  const double cell = 1.0 / static_cast<double>(side);
  for (const auto candidate : {x, x - side, x + side}) {
    const double west = static_cast<double>(candidate) * cell;
    if (west < bounds.east && west + cell > bounds.west) return candidate;
  }
  return x;
}

std::uint64_t MapView::storedRevision(const geo::TileKey& key, tiling::Layer layer,
                                      std::optional<Error>& error) const {
  auto revision = reader_.layerRevision(key, layer);
  if (revision) return *revision;
  if (revision.error().code != ErrorCode::NotFound) error = revision.error();
  return 0;
}

Result<Composition> MapView::compose(tiling::Layer layer, const LinkKey& key) const {
  Composition out;
  if (!isXyz())
    return fail(ErrorCode::Unsupported,
                "this map's lattice is " + meta_.lattice + ", which has no XYZ tiles; use `overfly export`");
  const auto zooms = reader_.zoomRange(layer);
  const auto bounds = reader_.bounds(layer);
  if (!zooms || !bounds) {
    const auto& error = zooms ? bounds.error() : zooms.error();
    if (error.code == ErrorCode::NotFound) return out;
    return tl::unexpected(error);
  }
  std::optional<Error> error;

  // A whole 256-texel block of the stored tile that holds link tile `k`, at (to_x, to_y).
  const auto addBlock = [&](const LinkKey& k, int to_x, int to_y, int to_side) {
    const geo::TileKey stored{k.zoom - shift_, unwrapped(k.x >> shift_, k.zoom - shift_, *bounds),
                              k.y >> shift_};
    const auto revision = storedRevision(stored, layer, error);
    if (revision == 0) return false;
    const std::int64_t mask = (std::int64_t{1} << shift_) - 1;
    out.pieces.push_back({stored, revision, static_cast<int>(k.x & mask) * kLinkTile,
                          static_cast<int>(k.y & mask) * kLinkTile, kLinkTile, to_x, to_y, to_side});
    return true;
  };

  const int min_zoom = zooms->first + shift_;
  if (key.zoom < min_zoom) {
    // coarser than anything stored: from the coarsest level, averaged
    const int depth = min_zoom - key.zoom;
    if (depth > overzoom_) return out;
    const int parts = 1 << depth, part = kLinkTile >> depth;
    for (int j = 0; j < parts; ++j)
      for (int i = 0; i < parts; ++i)
        (void)addBlock({min_zoom, (key.x << depth) + i, (key.y << depth) + j}, i * part, j * part, part);
  } else if (!addBlock(key, 0, 0, kLinkTile)) {
    // finer than anything stored here: from the nearest ancestor, interpolated
    for (int up = 1; up <= overzoom_ && key.zoom - up >= min_zoom; ++up) {
      const LinkKey ancestor{key.zoom - up, key.x >> up, key.y >> up};
      if (!addBlock(ancestor, 0, 0, kLinkTile)) continue;
      auto& piece = out.pieces.back();
      const std::int64_t mask = (std::int64_t{1} << up) - 1;
      piece.from_side = kLinkTile >> up;
      piece.from_x += static_cast<int>(key.x & mask) * piece.from_side;
      piece.from_y += static_cast<int>(key.y & mask) * piece.from_side;
      break;
    }
  }
  if (error) return tl::unexpected(*error);
  return out;
}

std::optional<geo::TileKey> MapView::storedKey(const LinkKey& key) const {
  const auto bounds = reader_.bounds(tiling::Layer::Color);
  if (!isXyz() || !bounds || key.zoom < shift_) return std::nullopt;
  const int up = std::max(0, key.zoom - shift_ - meta_.base_zoom) + shift_;
  const int zoom = key.zoom - up;
  return geo::TileKey{zoom, unwrapped(key.x >> up, zoom, *bounds), key.y >> up};
}

bool MapView::isWhole(const Composition& composition) const {
  return composition.pieces.size() == 1 && composition.pieces[0].from_side == meta_.tile_size &&
         composition.pieces[0].to_side == kLinkTile;
}

namespace {

template <typename Decode>
Result<Rgba> composeColor(const Composition& composition, const tiling::MapReader& reader,
                          tiling::Layer layer, Decode decode) {
  Rgba out(kLinkTile, kLinkTile);
  for (const auto& piece : composition.pieces) {
    const auto stored = reader.read(piece.key, layer);
    if (!stored) {
      if (stored.error().code == ErrorCode::NotFound) continue;  // erased since
      return tl::unexpected(stored.error());
    }
    const auto image = decode(*stored);
    if (!image) return tl::unexpected(image.error());
    place(*image, piece, out);
  }
  return out;
}

}  // namespace

Result<Rgba> MapView::picture(const Composition& composition, tiling::Layer layer) const {
  return composeColor(composition, reader_, layer, [this](const tiling::StoredLayer& stored) {
    return decodeColorLayer(stored, meta_.tile_size);
  });
}

Result<Rgba> MapView::quality(const Composition& composition) const {
  return composeColor(composition, reader_, tiling::Layer::Quality,
                      [this](const tiling::StoredLayer& layer) -> Result<Rgba> {
                        const auto quality = decodeQualityLayer(layer, meta_.tile_size);
                        if (!quality) return tl::unexpected(quality.error());
                        return qualityColours(*quality);
                      });
}

Result<std::shared_ptr<const Heights>> MapView::storedHeights(const geo::TileKey& key,
                                                              std::uint64_t revision) const {
  const auto known = std::ranges::find_if(
      recent_heights_, [&](const CachedHeights& c) { return c.key == key && c.revision == revision; });
  if (known != recent_heights_.end()) {
    recent_heights_.splice(recent_heights_.begin(), recent_heights_, known);
    return known->heights;
  }
  const auto stored = reader_.read(key, tiling::Layer::Elevation);
  if (!stored) return tl::unexpected(stored.error());
  auto heights = decodeHeightsLayer(*stored, meta_.tile_size);
  if (!heights) return tl::unexpected(heights.error());
  auto shared = std::make_shared<const Heights>(std::move(*heights));
  recent_heights_.push_front({key, stored->revision, shared});
  if (recent_heights_.size() > kRecentHeights) recent_heights_.pop_back();
  return shared;
}

Result<Heights> MapView::heights(const Composition& composition) const {
  Heights out(kLinkTile, kLinkTile);
  for (const auto& piece : composition.pieces) {
    const auto stored = storedHeights(piece.key, piece.revision);
    if (!stored) {
      if (stored.error().code == ErrorCode::NotFound) continue;
      return tl::unexpected(stored.error());
    }
    place(**stored, piece, out);
  }
  return out;
}

Result<Composition> MapView::neighbourhood(const LinkKey& key) const {
  Composition out;
  const auto side = std::int64_t{1} << key.zoom;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const LinkKey k{key.zoom, (key.x + dx + side) % side, key.y + dy};
      if (k.y < 0 || k.y >= side) continue;
      auto one = compose(tiling::Layer::Elevation, k);
      if (!one) return one;
      out.pieces.insert(out.pieces.end(), one->pieces.begin(), one->pieces.end());
    }
  return out;
}

Result<Heights> MapView::borderedHeights(const LinkKey& key) const {
  Heights out(kLinkTile + 2, kLinkTile + 2);
  const auto side = std::int64_t{1} << key.zoom;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const LinkKey k{key.zoom, (key.x + dx + side) % side, key.y + dy};
      if (k.y < 0 || k.y >= side) continue;
      const auto composition = compose(tiling::Layer::Elevation, k);
      if (!composition) return tl::unexpected(composition.error());
      const auto part = heights(*composition);
      if (!part) return part;
      const int left = dx < 0 ? kLinkTile - 1 : 0, right = dx > 0 ? 1 : kLinkTile;
      const int top = dy < 0 ? kLinkTile - 1 : 0, bottom = dy > 0 ? 1 : kLinkTile;
      for (int y = top; y < bottom; ++y)
        for (int x = left; x < right; ++x)
          out.at(1 + x + dx * kLinkTile, 1 + y + dy * kLinkTile) = part->at(x, y);
    }
  return out;
}

std::optional<std::pair<float, float>> MapView::heightRange() const {
  const auto zooms = reader_.zoomRange(tiling::Layer::Elevation);
  if (!zooms) return std::nullopt;
  const auto keys = reader_.keys(zooms->first, tiling::Layer::Elevation, {}, 64);
  if (!keys) return std::nullopt;
  std::optional<std::pair<float, float>> out;
  for (const auto& key : *keys) {
    const auto layer = reader_.read(key, tiling::Layer::Elevation);
    if (!layer || layer->encoded.statistics.valid == 0) continue;
    const auto& s = layer->encoded.statistics;
    out =
        out ? std::pair(std::min(out->first, s.min), std::max(out->second, s.max)) : std::pair(s.min, s.max);
  }
  return out;
}

Result<MapView::Height> MapView::heightAt(double lat, double lon) const {
  const auto zooms = reader_.zoomRange(tiling::Layer::Elevation);
  const auto bounds = reader_.bounds(tiling::Layer::Elevation);
  if (!zooms || !bounds) return fail(ErrorCode::NotFound, "the map has no heights yet");
  const auto plane = lattice_.planeFromGeodetic(lat, lon, 0.5 * (bounds->west + bounds->east));
  if (!plane) return fail(ErrorCode::NotFound, "the point lies outside the map's projection");
  for (int zoom = zooms->second; zoom >= zooms->first; --zoom) {
    const auto key = geo::TileLattice::keyAt(*plane, zoom);
    const auto stored = reader_.read(key, tiling::Layer::Elevation);
    if (!stored) {
      if (stored.error().code == ErrorCode::NotFound) continue;
      return tl::unexpected(stored.error());
    }
    const auto heights = decodeHeightsLayer(*stored, meta_.tile_size);
    if (!heights) return tl::unexpected(heights.error());
    const Eigen::Vector2d corner = geo::TileLattice::planeOf(key);
    const Eigen::Vector2d texel = (*plane - corner) * std::ldexp(meta_.tile_size, zoom);
    const float height = bilinear(*heights, texel.x(), texel.y());
    if (std::isnan(height)) continue;
    Height out;
    out.height_m = static_cast<double>(height);
    out.texel_m = lattice_.texelSize(zoom, lat, lon, meta_.tile_size);
    out.revision = stored->revision;
    if (const auto info = reader_.info(key)) {
      out.gsd_m = static_cast<double>(info->gsd_m);
      out.frame_set = info->frame_set;
    }
    if (const auto layer = reader_.read(key, tiling::Layer::Quality)) {
      if (const auto quality = decodeQualityLayer(*layer, meta_.tile_size)) {
        const int last = quality->size - 1;
        const auto x = static_cast<std::size_t>(std::clamp(static_cast<int>(texel.x()), 0, last));
        const auto y = static_cast<std::size_t>(std::clamp(static_cast<int>(texel.y()), 0, last));
        const auto i = y * static_cast<std::size_t>(quality->size) + x;
        out.confidence = quality->confidence[i] / 255.0;
        out.views = quality->views[i];
      }
    }
    return out;
  }
  return fail(ErrorCode::NotFound, "the map has no height there");
}

std::optional<tiling::PlaneBox> MapView::planeBox(const DegreeBox& box) const {
  constexpr double kMercatorLimit = 85.05;
  const double near = [&] {
    const auto bounds = reader_.bounds(tiling::Layer::Color);
    return bounds ? 0.5 * (bounds->west + bounds->east) : 0.5;
  }();
  const auto plane = [&](double lat, double lon) {
    return lattice_.planeFromGeodetic(geo::radians(std::clamp(lat, -kMercatorLimit, kMercatorLimit)),
                                      geo::radians(lon), near);
  };
  const auto nw = plane(box.north, box.west), se = plane(box.south, box.east);
  if (!nw || !se) return std::nullopt;
  tiling::PlaneBox out{nw->x(), nw->y(), se->x(), se->y()};
  if (out.west > out.east && lattice_.kind() == geo::LatticeKind::WebMercator) out.west -= 1;
  if (out.west > out.east || out.north > out.south) return std::nullopt;
  return out;
}

}  // namespace overfly::link
