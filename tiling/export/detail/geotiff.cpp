#include <fmt/format.h>
#include <gdal_priv.h>
#include <gdal_utils.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>

#include "capture/geo/vertical_datum.h"
#include "tiling/export/detail/source.h"

namespace overfly::tiling::detail {
namespace {

using capture::VerticalDatum;
using geo::LatticeKind;

constexpr double kCellMetres = 2 * 3.14159265358979323846 * 6378137.0;  // a zoom-0 cell of any lattice

tl::unexpected<Error> gdalError(const std::string& doing) {
  const char* message = CPLGetLastErrorMsg();
  return fail(ErrorCode::Io,
              fmt::format("{}: {}", doing, message != nullptr && *message != 0 ? message : "GDAL failed"));
}

// The lattice's own CRS, and how its metres lie in it: east = x0 + px * cell, north = y0 - py * cell.
struct Plane {
  OGRSpatialReference srs;
  double x0 = 0, y0 = 0;
};

Result<Plane> planeOf(const ExportSource& source) {
  Plane plane;
  plane.srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  OGRErr code = OGRERR_FAILURE;
  const std::string& text = source.meta.lattice;
  switch (source.lattice.kind()) {
    case LatticeKind::WebMercator:
      code = plane.srs.importFromEPSG(3857);
      plane.x0 = -kCellMetres / 2;
      plane.y0 = kCellMetres / 2;
      break;
    case LatticeKind::Utm: {  // "utm:33N"
      const bool north = text.back() == 'N';
      code = plane.srs.importFromEPSG((north ? 32600 : 32700) + std::stoi(text.substr(4)));
      plane.x0 = 500000;
      plane.y0 = north ? 0 : 10000000;
      break;
    }
    case LatticeKind::Ups:
      code = plane.srs.importFromEPSG(text.back() == 'N' ? 5041 : 5042);  // easting, northing
      plane.x0 = plane.y0 = 2000000;
      break;
    case LatticeKind::Local: {  // "local:LAT,LON"
      const std::size_t comma = text.find(',');
      const std::string proj = fmt::format("+proj=aeqd +lat_0={} +lon_0={} +datum=WGS84 +units=m +no_defs",
                                           text.substr(6, comma - 6), text.substr(comma + 1));
      code = plane.srs.importFromProj4(proj.c_str());
      break;
    }
  }
  if (code != OGRERR_NONE) return gdalError("the map's projection");
  return plane;
}

Result<OGRSpatialReference> targetOf(const ExportSource& source, const PlaneBox& box, const Plane& plane) {
  if (!source.options.epsg && !source.options.utm) return plane.srs;
  int epsg = source.options.epsg.value_or(0);
  if (source.options.utm) {
    const geo::Geodetic middle =
        source.lattice.geodeticFromPlane({(box.west + box.east) / 2, (box.north + box.south) / 2});
    const int zone =
        std::clamp(static_cast<int>(std::floor((geo::degrees(middle.lon) + 180) / 6)) + 1, 1, 60);
    epsg = (middle.lat >= 0 ? 32600 : 32700) + zone;
  }
  OGRSpatialReference srs;
  srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  if (srs.importFromEPSG(epsg) != OGRERR_NONE || (srs.IsProjected() == 0 && srs.IsGeographic() == 0))
    return fail(ErrorCode::BadInput, fmt::format("EPSG:{} is no horizontal CRS that GDAL knows", epsg));
  return srs;
}

// Horizontal CRS and vertical reference together, where the map knows one.
OGRSpatialReference withVertical(const OGRSpatialReference& horizontal, VerticalDatum datum,
                                 const std::string& geoid) {
  OGRSpatialReference srs = horizontal;
  if (datum == VerticalDatum::Ellipsoid) {
    // GeoTIFF has keys for ellipsoidal heights of a geographic CRS only; of a projected one the metadata item
    // VERTICAL_DATUM tells.
    if (srs.IsGeographic() != 0) srs.PromoteTo3D(nullptr);
  } else if (datum == VerticalDatum::Geoid) {
    const int epsg = geoid.starts_with("egm96")                                   ? 5773
                     : geoid.starts_with("egm2008") || geoid.starts_with("egm08") ? 3855
                                                                                  : 0;
    OGRSpatialReference vertical;
    if (epsg != 0 && vertical.importFromEPSG(epsg) == OGRERR_NONE)
      srs.SetCompoundCS(fmt::format("{} + {}", horizontal.GetName(), vertical.GetName()).c_str(), &horizontal,
                        &vertical);
  }
  srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return srs;
}

// What turns the map's heights into the wanted ones.
struct HeightShift {
  VerticalDatum datum = VerticalDatum::Unknown;  // of the result
  std::string geoid_name;
  std::optional<geo::Geoid> geoid;  // absent: nothing to do
  double sign = 0;
};

Result<HeightShift> heightShift(const ExportSource& source) {
  HeightShift shift;
  const VerticalDatum have = source.meta.datum, want = source.options.datum.value_or(have);
  shift.datum = want;
  shift.geoid_name = source.meta.geoid;
  if (source.options.layer != Layer::Elevation) return shift;
  if (have == want && (want != VerticalDatum::Geoid || source.options.geoid_grid.empty())) return shift;
  const auto known = [](VerticalDatum datum) {
    return datum == VerticalDatum::Ellipsoid || datum == VerticalDatum::Geoid;
  };
  if (!known(have) || !known(want))
    return fail(ErrorCode::BadInput,
                fmt::format("the map's heights are {}: they cannot be converted, only exported "
                            "as they are",
                            source.datumText(have)));
  if (have == want) return fail(ErrorCode::BadInput, "heights of one geoid are not converted to another's");
  auto geoid = geo::Geoid::load(source.options.geoid_grid.empty() ? std::string(geo::Geoid::kDefaultGrid)
                                                                  : source.options.geoid_grid);
  if (!geoid) return tl::unexpected(geoid.error());
  shift.sign = want == VerticalDatum::Geoid ? -1 : 1;
  if (want == VerticalDatum::Geoid) shift.geoid_name = geoid->name();
  // The map's own model is the one to take its heights back by.
  if (have == VerticalDatum::Geoid && !source.meta.geoid.empty() &&
      !geoid->name().starts_with(source.meta.geoid) && !source.meta.geoid.starts_with(geoid->name()))
    return fail(ErrorCode::BadInput,
                fmt::format("the map's heights count from the geoid {}: name its grid, not {}",
                            source.meta.geoid, geoid->name()));
  shift.geoid = std::move(*geoid);
  return shift;
}

void shiftHeights(const ExportSource& source, const HeightShift& shift, Tile& tile) {
  if (!shift.geoid || tile.elevation.empty()) return;
  for (int y = 0; y < tile.size; ++y)
    for (int x = 0; x < tile.size; ++x) {
      float& height = tile.elevation[static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.size) +
                                     static_cast<std::size_t>(x)];
      if (std::isnan(height)) continue;
      const geo::Geodetic place = source.lattice.geodeticFromPlane(
          geo::TileLattice::planeOf(tile.key, (x + 0.5) / tile.size, (y + 0.5) / tile.size));
      height = static_cast<float>(height + shift.sign * shift.geoid->undulation(place.lat, place.lon));
    }
}

struct Bands {
  int count = 0;
  GDALDataType type = GDT_Byte;
  std::vector<const char*> names;
};
Bands bandsOf(Layer layer) {
  if (layer == Layer::Elevation) return {1, GDT_Float32, {"elevation"}};
  if (isPicture(layer)) return {4, GDT_Byte, {"red", "green", "blue", "alpha"}};
  return {3, GDT_Byte, {"confidence", "views", "kind"}};
}

CPLErr writeTile(GDALDataset& file, const Tile& tile, Layer layer, int column, int row) {
  const int size = tile.size;
  if (isPicture(layer))
    return file.RasterIO(GF_Write, column, row, size, size, const_cast<std::uint8_t*>(tile.color.data()),
                         size, size, GDT_Byte, 4, nullptr, 4, 4 * size, 1, nullptr);
  if (layer == Layer::Elevation)
    return file.GetRasterBand(1)->RasterIO(GF_Write, column, row, size, size,
                                           const_cast<float*>(tile.elevation.data()), size, size, GDT_Float32,
                                           0, 0);
  int band = 1;
  for (const std::vector<std::uint8_t>* plane : {&tile.confidence, &tile.views, &tile.kind})
    if (const CPLErr code = file.GetRasterBand(band++)->RasterIO(GF_Write, column, row, size, size,
                                                                 const_cast<std::uint8_t*>(plane->data()),
                                                                 size, size, GDT_Byte, 0, 0);
        code != CE_None)
      return code;
  return CE_None;
}

void describe(GDALDataset& file, const ExportSource& source, const HeightShift& shift) {
  const Bands bands = bandsOf(source.options.layer);
  for (int band = 1; band <= bands.count; ++band)
    file.GetRasterBand(band)->SetDescription(bands.names[static_cast<std::size_t>(band - 1)]);
  if (isPicture(source.options.layer)) {
    const GDALColorInterp colors[] = {GCI_RedBand, GCI_GreenBand, GCI_BlueBand, GCI_AlphaBand};
    for (int band = 1; band <= 4; ++band) file.GetRasterBand(band)->SetColorInterpretation(colors[band - 1]);
  }
  if (source.options.layer == Layer::Elevation) {
    file.GetRasterBand(1)->SetUnitType("metre");
    const std::string geoid = shift.geoid_name.empty() ? "model unknown" : shift.geoid_name;
    file.SetMetadataItem("VERTICAL_DATUM",
                         (shift.datum == VerticalDatum::Geoid ? fmt::format("geoid ({})", geoid)
                                                              : source.datumText(shift.datum))
                             .c_str());
  }
  file.SetMetadataItem("OVERFLY_MAP", source.meta.id.c_str());
  if (const auto revision = source.reader.revision())
    file.SetMetadataItem("OVERFLY_REVISION", std::to_string(*revision).c_str());
  if (!source.meta.name.empty()) file.SetMetadataItem("TIFFTAG_IMAGEDESCRIPTION", source.meta.name.c_str());
}

// A stage's share of the whole, as GDAL's progress callback.
struct Stage {
  const ExportProgress& progress;
  double from, to;
  static int CPL_STDCALL report(double share, const char*, void* self) {
    const auto& stage = *static_cast<const Stage*>(self);
    return !stage.progress || stage.progress(stage.from + share * (stage.to - stage.from)) ? TRUE : FALSE;
  }
};

class Temporary {
 public:
  explicit Temporary(std::string at) : path(std::move(at)) {}
  ~Temporary() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  const std::string path;
};

Result<GDALDatasetUniquePtr> warp(GDALDataset& from, const std::string& to, const OGRSpatialReference& target,
                                  Layer layer, Stage stage) {
  char* wkt = nullptr;
  target.exportToWkt(&wkt);
  const std::string target_wkt = wkt;
  CPLFree(wkt);
  std::vector<std::string> words{
      "-t_srs", target_wkt,         "-of", "GTiff",
      "-co",    "TILED=YES",        "-co", "COMPRESS=LZW",
      "-co",    "BIGTIFF=IF_SAFER", "-r",  layer == Layer::Quality ? "near" : "bilinear"};
  if (layer == Layer::Elevation) words.insert(words.end(), {"-srcnodata", "nan", "-dstnodata", "nan"});
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const std::unique_ptr<GDALWarpAppOptions, decltype(&GDALWarpAppOptionsFree)> options(
      GDALWarpAppOptionsNew(arguments.data(), nullptr), &GDALWarpAppOptionsFree);
  if (!options) return gdalError("the projection's options");
  GDALWarpAppOptionsSetProgress(options.get(), &Stage::report, &stage);
  GDALDatasetH sources[] = {GDALDataset::ToHandle(&from)};
  int misuse = 0;
  GDALDatasetUniquePtr warped(
      GDALDataset::FromHandle(GDALWarp(to.c_str(), nullptr, 1, sources, options.get(), &misuse)));
  if (!warped) return gdalError("projecting the map");
  return warped;
}

}  // namespace

Result<ExportReport> exportGeoTiff(const ExportSource& source, const std::filesystem::path& out,
                                   const ExportProgress& progress) {
  static std::once_flag registered;
  std::call_once(registered, [] { GDALAllRegister(); });
  CPLPushErrorHandler(CPLQuietErrorHandler);
  const std::unique_ptr<void, void (*)(void*)> pop_handler(reinterpret_cast<void*>(1),
                                                           [](void*) { CPLPopErrorHandler(); });
  CPLErrorReset();
  // Nothing goes into a file beside the GeoTIFF: what it cannot hold itself would be lost on the way.
  const CPLConfigOptionSetter no_side_file("GDAL_PAM_ENABLED", "NO", false);
  GDALDriver* const tiff = GetGDALDriverManager()->GetDriverByName("GTiff");
  GDALDriver* const cog = GetGDALDriverManager()->GetDriverByName("COG");
  if (tiff == nullptr || cog == nullptr) return fail(ErrorCode::Unsupported, "this GDAL writes no GeoTIFF");

  const Result<HeightShift> shift = heightShift(source);
  if (!shift) return tl::unexpected(shift.error());
  const Result<Plane> plane = planeOf(source);
  if (!plane) return tl::unexpected(plane.error());
  const auto keys = source.keys(source.max_zoom);
  if (!keys) return tl::unexpected(keys.error());
  if (keys->empty())
    return fail(ErrorCode::NotFound, fmt::format("the map has no tile at zoom {}", source.max_zoom));
  std::int64_t min_x = INT64_MAX, min_y = INT64_MAX, max_x = INT64_MIN, max_y = INT64_MIN;
  for (const geo::TileKey& key : *keys) {
    min_x = std::min(min_x, key.x);
    max_x = std::max(max_x, key.x);
    min_y = std::min(min_y, key.y);
    max_y = std::max(max_y, key.y);
  }
  const int size = source.meta.tile_size;
  const std::int64_t width = (max_x - min_x + 1) * size, height = (max_y - min_y + 1) * size;
  if (width > INT32_MAX || height > INT32_MAX)
    return fail(ErrorCode::BadInput,
                "the map is too wide for one picture at this zoom; choose a coarser --zoom");
  const PlaneBox box{std::ldexp(static_cast<double>(min_x), -source.max_zoom),
                     std::ldexp(static_cast<double>(min_y), -source.max_zoom),
                     std::ldexp(static_cast<double>(max_x + 1), -source.max_zoom),
                     std::ldexp(static_cast<double>(max_y + 1), -source.max_zoom)};
  const Result<OGRSpatialReference> target = targetOf(source, box, *plane);
  if (!target) return tl::unexpected(target.error());
  const bool warps = target->IsSame(&plane->srs) == 0;

  // 1. The tiles side by side, in the lattice's own CRS.
  const Temporary mosaic_file(out.string() + ".mosaic");
  const Temporary warped_file(out.string() + ".warped");
  const Bands bands = bandsOf(source.options.layer);
  const std::string block = std::to_string(std::max(size, 16));
  CPLStringList options;
  for (const auto& [key, value] : {std::pair<const char*, std::string>{"TILED", "YES"},
                                   {"BLOCKXSIZE", block},
                                   {"BLOCKYSIZE", block},
                                   {"COMPRESS", "LZW"},
                                   {"SPARSE_OK", "TRUE"},
                                   {"BIGTIFF", "IF_SAFER"}})
    options.SetNameValue(key, value.c_str());
  GDALDatasetUniquePtr mosaic(tiff->Create(mosaic_file.path.c_str(), static_cast<int>(width),
                                           static_cast<int>(height), bands.count, bands.type,
                                           options.List()));
  if (!mosaic) return gdalError(mosaic_file.path);
  // Unwrapped columns come home by whole turns of the globe.
  const double turns = source.lattice.kind() == LatticeKind::WebMercator ? std::floor(box.west) : 0;
  const double texel = std::ldexp(kCellMetres, -source.max_zoom) / size;
  double transform[6] = {plane->x0 + (box.west - turns) * kCellMetres, texel, 0,
                         plane->y0 - box.north * kCellMetres,          0,     -texel};
  OGRSpatialReference mosaic_srs = plane->srs;
  if (warps && source.lattice.kind() == LatticeKind::WebMercator && box.east - turns > 1) {
    // Across the antimeridian: projecting from Web Mercator would lose what lies beyond its edge, so the
    // same plane is counted from the meridian opposite to the edge's.
    transform[0] -= kCellMetres / 2;
    if (mosaic_srs.importFromProj4("+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +lon_0=180 +x_0=0 +y_0=0 +k=1 "
                                   "+units=m +nadgrids=@null +no_defs") != OGRERR_NONE)
      return gdalError("the map's projection");
  }
  mosaic->SetGeoTransform(transform);
  mosaic->SetSpatialRef(&mosaic_srs);
  if (source.options.layer == Layer::Elevation) mosaic->GetRasterBand(1)->SetNoDataValue(std::nan(""));
  describe(*mosaic, source, *shift);

  ExportReport report;
  report.min_zoom = report.max_zoom = source.max_zoom;
  const Stage reading{progress, 0, 0.4};
  for (std::size_t i = 0; i < keys->size(); ++i) {
    const geo::TileKey& key = (*keys)[i];
    Result<Tile> tile = source.tile(key);
    if (tile) {
      shiftHeights(source, *shift, *tile);
      if (writeTile(*mosaic, *tile, source.options.layer, static_cast<int>((key.x - min_x) * size),
                    static_cast<int>((key.y - min_y) * size)) != CE_None)
        return gdalError(mosaic_file.path);
      ++report.tiles;
    } else if (tile.error().code == ErrorCode::Corrupt) {
      ++report.damaged_tiles;
    } else if (tile.error().code != ErrorCode::NotFound) {
      return tl::unexpected(tile.error());
    }
    const double share = static_cast<double>(i + 1) / static_cast<double>(keys->size());
    if (Stage::report(share, nullptr, const_cast<Stage*>(&reading)) == FALSE)
      return fail(ErrorCode::Unavailable, "the export was stopped");
  }
  CPLErrorReset();
  mosaic->FlushCache();
  if (CPLGetLastErrorType() == CE_Failure) return gdalError(mosaic_file.path);

  // 2. Another projection, 3. the cloud-optimised file with overviews.
  GDALDataset* whole = mosaic.get();
  GDALDatasetUniquePtr warped;
  if (warps) {
    auto done = warp(*mosaic, warped_file.path, *target, source.options.layer, {progress, 0.4, 0.7});
    if (!done) return tl::unexpected(done.error());
    warped = std::move(*done);
    whole = warped.get();
    describe(*whole, source, *shift);
  }
  if (source.options.layer == Layer::Elevation) {
    const OGRSpatialReference srs = withVertical(*target, shift->datum, shift->geoid_name);
    whole->SetSpatialRef(&srs);
  }
  CPLStringList cog_options;
  cog_options.SetNameValue("COMPRESS", "DEFLATE");
  cog_options.SetNameValue("PREDICTOR", "YES");
  cog_options.SetNameValue("BLOCKSIZE", "512");
  cog_options.SetNameValue("BIGTIFF", "IF_SAFER");
  cog_options.SetNameValue("RESAMPLING", source.options.layer == Layer::Quality ? "NEAREST" : "AVERAGE");
  Stage writing{progress, warps ? 0.7 : 0.4, 1};
  const GDALDatasetUniquePtr result(
      cog->CreateCopy(out.c_str(), whole, FALSE, cog_options.List(), &Stage::report, &writing));
  if (!result) return gdalError(out.string());
  return report;
}

}  // namespace overfly::tiling::detail
