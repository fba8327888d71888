#include "tiling/export/export.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "tiling/export/detail/source.h"

namespace overfly::tiling {
namespace detail {

Result<ExportSource> openSource(const MapReader& reader, const ExportOptions& options) {
  if (!isPicture(options.layer) && options.layer != Layer::Elevation && options.layer != Layer::Quality)
    return fail(ErrorCode::BadInput, "only pictures, elevation and quality can be exported");
  Result<MapMeta> meta = reader.meta();
  if (!meta) return tl::unexpected(meta.error());
  Result<geo::TileLattice> lattice = geo::TileLattice::parse(meta->lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  const auto range = reader.zoomRange(options.layer);
  if (!range) return tl::unexpected(range.error());
  ExportSource source{reader, options, std::move(*meta), *lattice, range->first, range->second};
  source.max_zoom = std::clamp(source.meta.base_zoom, range->first, range->second);
  if (options.zoom) {
    if (*options.zoom < range->first || *options.zoom > range->second)
      return fail(ErrorCode::BadInput,
                  fmt::format("the map has {} tiles at zooms {} to {}, not {}", name(options.layer),
                              range->first, range->second, *options.zoom));
    source.max_zoom = *options.zoom;
  }
  return source;
}

Result<std::vector<geo::TileKey>> ExportSource::keys(int zoom) const {
  std::vector<geo::TileKey> all;
  for (;;) {
    const auto some =
        reader.keys(zoom, options.layer, all.empty() ? std::nullopt : std::optional(all.back()), 4096);
    if (!some) return tl::unexpected(some.error());
    if (some->empty()) return all;
    all.insert(all.end(), some->begin(), some->end());
  }
}

Result<Tile> ExportSource::tile(const geo::TileKey& key) const {
  LayerSet layers = only(options.layer);
  if (options.measured_only) layers |= only(Layer::Quality);
  Result<Tile> tile = readTile(reader, key, layers);
  if (!tile || !options.measured_only) return tile;
  tile->kind.resize(tile->texels());  // without a quality layer nothing counts as measured
  for (std::size_t i = 0; i < tile->texels(); ++i) {
    if ((tile->kind[i] & kMeasured) != 0) continue;
    if (!tile->color.empty())
      std::fill_n(tile->color.begin() + static_cast<std::ptrdiff_t>(4 * i), 4, std::uint8_t{0});
    if (!tile->elevation.empty()) tile->elevation[i] = std::nanf("");
    if (options.layer == Layer::Quality && !tile->confidence.empty()) {
      tile->kind[i] = kNoData;
      tile->confidence[i] = tile->views[i] = 0;
    }
  }
  return tile;
}

std::string ExportSource::datumText(capture::VerticalDatum datum) const {
  switch (datum) {
    case capture::VerticalDatum::Ellipsoid:
      return "ellipsoid (WGS84)";
    case capture::VerticalDatum::Geoid:
      return fmt::format("geoid ({})", meta.geoid.empty() ? "model unknown" : meta.geoid);
    case capture::VerticalDatum::Home:
      return "above the start of the flight";
    case capture::VerticalDatum::Unknown:
      break;
  }
  return "unknown";
}

}  // namespace detail

Result<ExportFormat> exportFormat(const std::filesystem::path& out) {
  std::error_code ignored;
  std::string ending = out.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (ending == ".tif" || ending == ".tiff") return ExportFormat::GeoTiff;
  if (ending == ".mbtiles") return ExportFormat::MbTiles;
  if (ending == ".pmtiles") return ExportFormat::PmTiles;
  if (ending.empty() || std::filesystem::is_directory(out, ignored)) return ExportFormat::XyzFolder;
  return fail(ErrorCode::BadInput,
              fmt::format("{}: name a .tif, .mbtiles or .pmtiles file, or a folder", out.string()));
}

Result<ExportReport> exportMap(const MapReader& reader, const std::filesystem::path& out,
                               const ExportOptions& options, const ExportProgress& progress) {
  const Result<ExportFormat> format = exportFormat(out);
  if (!format) return tl::unexpected(format.error());
  std::error_code problem;
  const bool free = !std::filesystem::exists(out, problem) ||
                    (*format == ExportFormat::XyzFolder && std::filesystem::is_empty(out, problem));
  if (!free || problem)
    return fail(ErrorCode::BadInput,
                fmt::format("{} exists already; name another place, or remove it", out.string()));
  const Result<detail::ExportSource> source = detail::openSource(reader, options);
  if (!source) return tl::unexpected(source.error());
  if (*format != ExportFormat::GeoTiff) {
    if (source->lattice.kind() != geo::LatticeKind::WebMercator)
      return fail(ErrorCode::BadInput, fmt::format("the map lies on the lattice {}, which has no web tiles; "
                                                   "export it as .tif",
                                                   source->meta.lattice));
    if (options.epsg || options.utm || options.datum)
      return fail(ErrorCode::BadInput,
                  "web tiles have one projection and the map's own heights: choose a CRS or "
                  "a datum with .tif");
  }

  // Made beside its place and moved there when whole.
  const std::filesystem::path part =
      out.string() + (*format == ExportFormat::GeoTiff ? ".part.tif" : ".part");
  std::filesystem::remove_all(part, problem);
  Result<ExportReport> report = ExportReport{};
  if (*format == ExportFormat::GeoTiff) {
    report = detail::exportGeoTiff(*source, part, progress);
  } else {
    const auto sink = *format == ExportFormat::MbTiles   ? detail::mbTilesSink(part)
                      : *format == ExportFormat::PmTiles ? detail::pmTilesSink(part)
                                                         : detail::folderSink(part);
    report = detail::exportWebTiles(*source, *sink, progress);
  }
  if (!report) {
    std::filesystem::remove_all(part, problem);
    return report;
  }
  if (*format == ExportFormat::XyzFolder) std::filesystem::remove(out, problem);  // the empty one
  std::filesystem::rename(part, out, problem);
  if (problem) return fail(ErrorCode::Io, fmt::format("{}: {}", out.string(), problem.message()));
  if (*format == ExportFormat::XyzFolder) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(out, problem))
      if (entry.is_regular_file()) report->bytes += entry.file_size();
  } else {
    report->bytes = std::filesystem::file_size(out, problem);
  }
  return report;
}

}  // namespace overfly::tiling
