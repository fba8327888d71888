#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sqlite3.h>
#include <unistd.h>
#include <zlib.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>

#include "capture/geo/vertical_datum.h"
#include "tiling/export/detail/source.h"
#include "tiling/export/export.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {
namespace {

using testing::HasSubstr;

std::string outputOf(const std::string& command) {
  std::string text;
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  std::array<char, 4096> part{};
  while (std::size_t got = fread(part.data(), 1, part.size(), pipe)) text.append(part.data(), got);
  pclose(pipe);
  return text;
}

class ExportTest : public testing::Test {
 protected:
  static constexpr int kSize = 64;
  static constexpr int kZoom = 20;

  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ =
        std::filesystem::temp_directory_path() / fmt::format("overfly-export-{}.{}", info->name(), getpid());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override {
    if (std::getenv("OVERFLY_KEEP") == nullptr) std::filesystem::remove_all(folder_);
  }

  // The heights that the map holds: a slope in latitude and longitude, so that a wrong place is a wrong
  // height.
  static double heightAt(double lat, double lon, double lat0, double lon0) {
    return 100 + 2e5 * (lat - lat0) + 1e5 * (lon - lon0);
  }

  // 3 x 2 tiles around a place at kZoom, and a parent; the south-east tile's right half is a hole, its left
  // half is filled, not measured.
  void makeMap(double lat_deg, double lon_deg, MapMeta meta = {}, bool with_hole = true) {
    lat_ = geo::radians(lat_deg);
    lon_ = geo::radians(lon_deg);
    meta.tile_size = kSize;
    meta.base_zoom = kZoom;
    lattice_ = geo::TileLattice::parse(meta.lattice).value();
    auto store = MapStore::create(folder_ / "map.overfly", meta);
    ASSERT_TRUE(store) << store.error().message;
    const geo::TileKey middle = geo::TileLattice::keyAt(*lattice_.planeFromGeodetic(lat_, lon_), kZoom);
    Batch batch;
    const auto add = [&](const geo::TileKey& key, bool hole) {
      Tile tile = Tile::blank(key, kSize);
      for (int y = 0; y < kSize; ++y)
        for (int x = 0; x < kSize; ++x) {
          if (hole && x >= kSize / 2) continue;
          const auto i = static_cast<std::size_t>(y * kSize + x);
          const geo::Geodetic place = lattice_.geodeticFromPlane(
              geo::TileLattice::planeOf(key, (x + 0.5) / kSize, (y + 0.5) / kSize));
          double east = place.lon - lon_;
          east -= 2 * M_PI * std::round(east / (2 * M_PI));
          tile.elevation[i] = static_cast<float>(heightAt(place.lat, lon_ + east, lat_, lon_));
          const std::uint8_t rgba[] = {200, 100, 50, 255};
          std::copy(std::begin(rgba), std::end(rgba),
                    tile.color.begin() + static_cast<std::ptrdiff_t>(4 * i));
          tile.confidence[i] = 255;
          tile.views[i] = 4;
          tile.kind[i] = hole ? kFilled : kMeasured;
        }
      batch.tiles.push_back(encodeTile(tile, encodeOptions(store->meta())).value());
    };
    for (int y = 0; y < 2; ++y)
      for (int x = -1; x < 2; ++x) add({kZoom, middle.x + x, middle.y + y}, with_hole && y == 1 && x == 1);
    add(geo::parentOf(middle), false);
    ASSERT_TRUE(store->commit(batch));
    middle_ = middle;
  }
  [[nodiscard]] Result<ExportReport> run(const std::string& out, const ExportOptions& options = {}) const {
    const auto reader = MapReader::open(folder_ / "map.overfly");
    return exportMap(*reader, folder_ / out, options);
  }
  [[nodiscard]] nlohmann::json info(const std::string& file) const {
    const std::string text =
        outputOf(fmt::format("gdalinfo --config GDAL_PAM_ENABLED NO -json '{}'", (folder_ / file).string()));
    return nlohmann::json::parse(text.substr(text.find('{')));
  }
  // The value of a file at a place, as GDAL finds it.
  [[nodiscard]] double valueAt(const std::string& file, double lat_deg, double lon_deg, int band = 1) const {
    const std::string text =
        outputOf(fmt::format("gdallocationinfo -valonly -wgs84 -b {} '{}' {:.12f} {:.12f}", band,
                             (folder_ / file).string(), lon_deg, lat_deg));
    return text.empty() ? std::nan("") : std::strtod(text.c_str(), nullptr);
  }
  // The heights of a GeoTIFF at points within the map, against what the map was made from, in metres.
  void expectHeights(const std::string& file, double tolerance_m, double shift_m = 0) const {
    std::string points;
    std::vector<double> expected;
    for (const double u : {0.1, 0.5, 1.3, 2.0})
      for (const double v : {0.2, 0.9, 1.4}) {
        const geo::Geodetic place = lattice_.geodeticFromPlane(
            geo::TileLattice::planeOf({kZoom, middle_.x - 1, middle_.y}, u + 0.5 / kSize, v + 0.5 / kSize));
        double east = place.lon - lon_;
        east -= 2 * M_PI * std::round(east / (2 * M_PI));
        points += fmt::format("{:.12f} {:.12f}\n", geo::degrees(place.lon), geo::degrees(place.lat));
        expected.push_back(heightAt(place.lat, lon_ + east, lat_, lon_) + shift_m);
      }
    std::istringstream values(outputOf(fmt::format("printf '%b' '{}' | gdallocationinfo -valonly -wgs84 '{}'",
                                                   points, (folder_ / file).string())));
    for (const double height : expected) {
      double value = std::nan("");
      values >> value;
      EXPECT_NEAR(value, height, tolerance_m) << file;
    }
  }

  std::filesystem::path folder_;
  geo::TileLattice lattice_ = geo::TileLattice::webMercator();
  geo::TileKey middle_;
  double lat_ = 0, lon_ = 0;
};

// One texel is 0.6 m on the ground at zoom 20 and 64 texels; the slope is 3 to 5 cm a metre.
constexpr double kTexel = 0.03;

TEST_F(ExportTest, AGeoTiffLiesWhereTheMapLies) {
  MapMeta meta;
  meta.datum = capture::VerticalDatum::Ellipsoid;
  makeMap(-33.9, 151.2, meta);
  ExportOptions options;
  options.layer = Layer::Elevation;
  const auto report = run("dem.tif", options);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->tiles, 6u);
  EXPECT_EQ(report->max_zoom, kZoom);
  expectHeights("dem.tif", kTexel);
  const nlohmann::json about = info("dem.tif");
  EXPECT_EQ(about["size"], (nlohmann::json{3 * kSize, 2 * kSize}));
  EXPECT_EQ(about["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"], "COG");
  EXPECT_EQ(about["metadata"][""]["VERTICAL_DATUM"], "ellipsoid (WGS84)");
  EXPECT_EQ(about["files"].size(), 1u) << "all is in the one file";
  EXPECT_THAT(about["coordinateSystem"]["wkt"].get<std::string>(), HasSubstr("\"EPSG\",3857"));
  options.epsg = 4326;
  ASSERT_TRUE(run("geographic.tif", options));
  EXPECT_THAT(info("geographic.tif")["coordinateSystem"]["wkt"].get<std::string>(),
              HasSubstr("ellipsoidal height"));
  const auto hole =
      lattice_.geodeticFromPlane(geo::TileLattice::planeOf({kZoom, middle_.x + 1, middle_.y + 1}, 0.8, 0.5));
  EXPECT_TRUE(std::isnan(valueAt("dem.tif", geo::degrees(hole.lat), geo::degrees(hole.lon))));
}

TEST_F(ExportTest, UtmIsTheZoneOfTheMapInBothHemispheres) {
  for (const auto& [lat, lon, epsg] : {std::tuple{-33.9, 151.2, 32756}, std::tuple{47.5, 11.999, 32632},
                                       std::tuple{47.5, 12.001, 32633}, std::tuple{64.1, -21.9, 32627}}) {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    makeMap(lat, lon, {}, false);
    ExportOptions options;
    options.layer = Layer::Elevation;
    options.utm = true;
    const auto report = run("utm.tif", options);
    ASSERT_TRUE(report) << report.error().message;
    expectHeights("utm.tif", 2 * kTexel);
    EXPECT_THAT(info("utm.tif")["coordinateSystem"]["wkt"].get<std::string>(),
                HasSubstr(fmt::format("\"EPSG\",{}]]", epsg)));
  }
}

TEST_F(ExportTest, AnyEpsgAndEveryLattice) {
  for (const char* lattice : {"webmercator", "utm:33N", "utm:33S", "local:47.5,15.1"}) {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    MapMeta meta;
    meta.lattice = lattice;
    makeMap(std::strcmp(lattice, "utm:33S") == 0 ? -10.0 : 47.5, 15.1, meta, false);
    ExportOptions options;
    options.layer = Layer::Elevation;
    ASSERT_TRUE(run("own.tif", options));
    expectHeights("own.tif", kTexel);
    options.epsg = 4326;
    const auto report = run("geographic.tif", options);
    ASSERT_TRUE(report) << report.error().message;
    expectHeights("geographic.tif", 3 * kTexel);
  }
  ExportOptions options;
  options.epsg = 5773;  // vertical
  EXPECT_EQ(run("no.tif", options).error().code, ErrorCode::BadInput);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "no.tif"));
}

TEST_F(ExportTest, AcrossTheAntimeridianTheMapIsInOnePiece) {
  makeMap(-17.0, 179.9999);
  ExportOptions options;
  options.layer = Layer::Elevation;
  options.epsg = 32701;
  ASSERT_TRUE(run("fiji.tif", options));
  expectHeights("fiji.tif", 2 * kTexel);
}

TEST_F(ExportTest, HeightsAreConvertedBetweenEllipsoidAndGeoidAndOnlyWhereTheyAreKnown) {
  MapMeta meta;
  meta.datum = capture::VerticalDatum::Ellipsoid;
  makeMap(47.5, 15.1, meta, false);
  ExportOptions options;
  options.layer = Layer::Elevation;
  options.datum = capture::VerticalDatum::Geoid;
  const auto report = run("geoid.tif", options);
  ASSERT_TRUE(report) << report.error().message;
  const double undulation = geo::Geoid::load()->undulation(lat_, lon_);
  EXPECT_GT(undulation, 40);
  expectHeights("geoid.tif", kTexel + 0.01, -undulation);
  EXPECT_THAT(info("geoid.tif")["coordinateSystem"]["wkt"].get<std::string>(), HasSubstr("EGM96"));

  std::filesystem::remove_all(folder_);
  std::filesystem::create_directories(folder_);
  meta.datum = capture::VerticalDatum::Home;
  makeMap(47.5, 15.1, meta, false);
  EXPECT_EQ(run("geoid.tif", options).error().code, ErrorCode::BadInput);
  options.datum.reset();
  ASSERT_TRUE(run("home.tif", options));
  expectHeights("home.tif", kTexel);
  const nlohmann::json about = info("home.tif");
  EXPECT_THAT(about["coordinateSystem"]["wkt"].get<std::string>(), Not(HasSubstr("ellipsoidal height")));
  EXPECT_THAT(about["coordinateSystem"]["wkt"].get<std::string>(), Not(HasSubstr("VERTCRS")));
  EXPECT_EQ(about["metadata"][""]["VERTICAL_DATUM"], "above the start of the flight");
}

TEST_F(ExportTest, ColoursKeepTheirHolesAndMeasuredOnlyMakesMore) {
  makeMap(47.5, 15.1);
  ASSERT_TRUE(run("ortho.tif"));
  const auto at = [&](double u) {
    const auto place =
        lattice_.geodeticFromPlane(geo::TileLattice::planeOf({kZoom, middle_.x + 1, middle_.y + 1}, u, 0.5));
    return std::pair(geo::degrees(place.lat), geo::degrees(place.lon));
  };
  const auto [filled_lat, filled_lon] = at(0.25);
  const auto [hole_lat, hole_lon] = at(0.75);
  EXPECT_NEAR(valueAt("ortho.tif", filled_lat, filled_lon, 1), 200, 3);
  EXPECT_NEAR(valueAt("ortho.tif", filled_lat, filled_lon, 3), 50, 3);
  EXPECT_EQ(valueAt("ortho.tif", filled_lat, filled_lon, 4), 255);
  EXPECT_EQ(valueAt("ortho.tif", hole_lat, hole_lon, 4), 0);
  ExportOptions options;
  options.measured_only = true;
  ASSERT_TRUE(run("measured.tif", options));
  EXPECT_EQ(valueAt("measured.tif", filled_lat, filled_lon, 4), 0);
  EXPECT_EQ(valueAt("measured.tif", geo::degrees(lat_), geo::degrees(lon_), 4), 255);
  options.layer = Layer::Quality;
  options.measured_only = false;
  ASSERT_TRUE(run("quality.tif", options));
  EXPECT_EQ(valueAt("quality.tif", geo::degrees(lat_), geo::degrees(lon_), 1), 255);
  EXPECT_EQ(valueAt("quality.tif", geo::degrees(lat_), geo::degrees(lon_), 2), 4);
  EXPECT_EQ(valueAt("quality.tif", filled_lat, filled_lon, 3), kFilled);
}

TEST_F(ExportTest, MbTilesAreReadByGdalInTheRightPlace) {
  makeMap(-33.9, 151.2, {}, false);
  const auto report = run("map.mbtiles");
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->tiles, 7u);
  EXPECT_EQ(report->min_zoom, kZoom - 1);
  const nlohmann::json about = info("map.mbtiles");
  EXPECT_EQ(about["driverShortName"], "MBTiles");
  const geo::Geodetic corner =
      lattice_.geodeticFromPlane(geo::TileLattice::planeOf({kZoom, middle_.x - 1, middle_.y}));
  const auto& north_west = about["wgs84Extent"]["coordinates"][0][0];
  EXPECT_NEAR(north_west[0].get<double>(), geo::degrees(corner.lon), 1e-6);
  EXPECT_NEAR(north_west[1].get<double>(), geo::degrees(corner.lat), 1e-6);
  EXPECT_NEAR(valueAt("map.mbtiles", -33.9, 151.2, 2), 100, 3);
}

TEST_F(ExportTest, AFolderHoldsTheStoredTilesAndTerrariumHeights) {
  makeMap(47.5, 15.1, {}, false);
  ASSERT_TRUE(run("color"));
  const auto file = folder_ / "color" / std::to_string(kZoom) / std::to_string(middle_.x) /
                    fmt::format("{}.jpg", middle_.y);
  ASSERT_TRUE(std::filesystem::exists(file));
  const auto reader = MapReader::open(folder_ / "map.overfly");
  std::ifstream stream(file, std::ios::binary);
  const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_EQ(bytes, reader->read(middle_, Layer::Color)->encoded.bytes);

  ExportOptions options;
  options.layer = Layer::Elevation;
  options.zoom = kZoom;
  ASSERT_TRUE(run("heights", options));
  const auto png = folder_ / "heights" / std::to_string(kZoom) / std::to_string(middle_.x) /
                   fmt::format("{}.png", middle_.y);
  const std::string text = outputOf(fmt::format("gdallocationinfo -valonly '{}' 10 20", png.string()));
  double rgb[3] = {};
  ASSERT_EQ(std::sscanf(text.c_str(), "%lf %lf %lf", &rgb[0], &rgb[1], &rgb[2]), 3) << text;
  const Tile tile = readTile(*reader, middle_).value();
  EXPECT_NEAR(rgb[0] * 256 + rgb[1] + rgb[2] / 256 - 32768, tile.elevation[20 * kSize + 10], 1.0 / 512);
  const auto json = nlohmann::json::parse(std::ifstream(folder_ / "heights" / "tiles.json"));
  EXPECT_EQ(json["encoding"], "terrarium");
}

// The format's specification, read independently of the writer.
struct PmTiles {
  std::vector<std::uint8_t> bytes;
  explicit PmTiles(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(file), {});
  }
  [[nodiscard]] std::uint64_t number(std::size_t at) const {
    std::uint64_t value = 0;
    std::memcpy(&value, bytes.data() + at, 8);
    return value;
  }
  [[nodiscard]] std::string gunzip(std::uint64_t at, std::uint64_t length) const {
    z_stream stream{};
    inflateInit2(&stream, MAX_WBITS + 16);
    std::string plain(1 << 20, 0);
    stream.next_in = const_cast<Bytef*>(bytes.data() + at);
    stream.avail_in = static_cast<uInt>(length);
    stream.next_out = reinterpret_cast<Bytef*>(plain.data());
    stream.avail_out = static_cast<uInt>(plain.size());
    inflate(&stream, Z_FINISH);
    plain.resize(stream.total_out);
    inflateEnd(&stream);
    return plain;
  }
  struct Entry {
    std::uint64_t id, offset, length, run;
  };
  [[nodiscard]] std::vector<Entry> directory(std::uint64_t at, std::uint64_t length) const {
    const std::string plain = gunzip(at, length);
    std::size_t place = 0;
    const auto next = [&] {
      std::uint64_t value = 0;
      for (unsigned shift = 0;; shift += 7) {
        const auto byte = static_cast<std::uint8_t>(plain.at(place++));
        value |= std::uint64_t{byte & 0x7fU} << shift;
        if (byte < 0x80) return value;
      }
    };
    std::vector<Entry> entries(next());
    std::uint64_t last = 0;
    for (Entry& entry : entries) entry.id = last += next();
    for (Entry& entry : entries) entry.run = next();
    for (Entry& entry : entries) entry.length = next();
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const std::uint64_t code = next();
      entries[i].offset = code == 0 ? entries[i - 1].offset + entries[i - 1].length : code - 1;
    }
    return entries;
  }
  // All tiles: through the leaves where there are some.
  [[nodiscard]] std::vector<Entry> tiles() const {
    std::vector<Entry> all;
    for (const Entry& entry : directory(number(8), number(16))) {
      if (entry.run > 0) {
        all.push_back(entry);
        continue;
      }
      const auto leaf = directory(number(40) + entry.offset, entry.length);
      all.insert(all.end(), leaf.begin(), leaf.end());
    }
    return all;
  }
};

TEST_F(ExportTest, PmTilesHoldEveryTileUnderItsHilbertNumber) {
  EXPECT_EQ(detail::pmTileId(0, 0, 0), 0u);
  EXPECT_EQ(detail::pmTileId(1, 0, 0), 1u);
  EXPECT_EQ(detail::pmTileId(1, 0, 1), 2u);
  EXPECT_EQ(detail::pmTileId(1, 1, 1), 3u);
  EXPECT_EQ(detail::pmTileId(1, 1, 0), 4u);
  EXPECT_EQ(detail::pmTileId(2, 0, 0), 5u);
  EXPECT_EQ(detail::pmTileId(12, 3423, 1763), 19078479u);  // from the specification's own tests
  std::set<std::uint64_t> ids;
  for (std::uint64_t x = 0; x < 32; ++x)
    for (std::uint64_t y = 0; y < 32; ++y) ids.insert(detail::pmTileId(5, x, y));
  EXPECT_EQ(ids.size(), 1024u);
  EXPECT_EQ(*ids.begin(), 341u);

  makeMap(47.5, 15.1);
  ASSERT_TRUE(run("map.pmtiles"));
  const PmTiles file(folder_ / "map.pmtiles");
  EXPECT_EQ(std::memcmp(file.bytes.data(), "PMTiles\3", 8), 0);
  const auto entries = file.tiles();
  ASSERT_EQ(entries.size(), 7u);
  const auto reader = MapReader::open(folder_ / "map.overfly");
  const std::uint64_t id = detail::pmTileId(kZoom, static_cast<std::uint64_t>(middle_.x + 1),
                                            static_cast<std::uint64_t>(middle_.y + 1));
  const auto found =
      std::find_if(entries.begin(), entries.end(), [&](const auto& entry) { return entry.id == id; });
  ASSERT_NE(found, entries.end());
  const auto begin = file.bytes.begin() + static_cast<std::ptrdiff_t>(file.number(56) + found->offset);
  EXPECT_EQ(std::vector<std::uint8_t>(begin, begin + static_cast<std::ptrdiff_t>(found->length)),
            reader->read({kZoom, middle_.x + 1, middle_.y + 1}, Layer::Color)->encoded.bytes);
  EXPECT_EQ(file.bytes[99], 4) << "WebP, because of the hole";
  EXPECT_EQ(nlohmann::json::parse(file.gunzip(file.number(24), file.number(32)))["type"], "overlay");
}

TEST_F(ExportTest, PmTilesOfManyTilesHaveLeaves) {
  const auto sink = detail::pmTilesSink(folder_ / "many.pmtiles");
  ASSERT_TRUE(sink->begin({}));
  std::map<std::uint64_t, geo::TileKey> keys;
  for (int x = 0; x < 100; ++x)
    for (int y = 0; y < 100; ++y)
      keys[detail::pmTileId(16, static_cast<std::uint64_t>(x * 7 + y % 5),
                            static_cast<std::uint64_t>(y * 3))] = {16, x * 7 + y % 5, y * 3};
  std::mt19937 random(1);  // lengths that do not compress: the directory outgrows the root's room
  for (const auto& [id, key] : keys)
    ASSERT_TRUE(
        sink->add(key, std::vector<std::uint8_t>(1 + random() % 20000, static_cast<std::uint8_t>(id))));
  ASSERT_TRUE(sink->finish());
  const PmTiles file(folder_ / "many.pmtiles");
  EXPECT_LE(file.number(8) + file.number(16), 16384u);
  EXPECT_GT(file.number(48), 0u);
  const auto entries = file.tiles();
  ASSERT_EQ(entries.size(), keys.size());
  auto expected = keys.begin();
  for (const auto& entry : entries) {
    ASSERT_EQ(entry.id, expected->first);
    ASSERT_EQ(file.bytes[file.number(56) + entry.offset], static_cast<std::uint8_t>(entry.id));
    ++expected;
  }
}

TEST_F(ExportTest, WhatCannotBeDoneIsSaidAndLeavesNothing) {
  makeMap(47.5, 15.1);
  EXPECT_EQ(run("map.jp2").error().code, ErrorCode::BadInput);
  ExportOptions options;
  options.zoom = 3;
  EXPECT_THAT(run("a.tif", options).error().message, HasSubstr("zooms 19 to 20"));
  options = {};
  options.utm = true;
  EXPECT_EQ(run("a.mbtiles", options).error().code, ErrorCode::BadInput);
  ASSERT_TRUE(run("a.mbtiles"));
  EXPECT_THAT(run("a.mbtiles").error().message, HasSubstr("exists already"));
  const auto reader = MapReader::open(folder_ / "map.overfly");
  EXPECT_FALSE(exportMap(*reader, folder_ / "stopped.tif", {}, [](double) { return false; }));
  EXPECT_FALSE(exportMap(*reader, folder_ / "stopped.pmtiles", {}, [](double) { return false; }));
  for (const auto& entry : std::filesystem::directory_iterator(folder_))
    EXPECT_THAT(entry.path().filename().string(), Not(HasSubstr("stopped")));
}

}  // namespace
}  // namespace overfly::tiling
