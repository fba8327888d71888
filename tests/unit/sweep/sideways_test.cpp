// Nothing is shifted sideways on the way from frames to the files that others read: exports are opened by
// independent programs and compared with the scene's truth.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/sweep/mapper_scene.h"
#include "tests/unit/sweep/shifts.h"
#include "tiling/export/export.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {
namespace {

using test::kGround;
using test::kTile;
using test::kZoom;

std::string outputOf(const std::string& command) {
  std::string text;
  FILE* pipe = popen(command.c_str(), "r");
  std::array<char, 4096> part{};
  while (std::size_t got = fread(part.data(), 1, part.size(), pipe)) text.append(part.data(), got);
  pclose(pipe);
  return text;
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1,
                         static_cast<std::size_t>(q * static_cast<double>(values.size())))];
}

test::Scene hills() {
  return {[](double east, double north) {
            return kGround + 0.8 * std::sin(0.45 * east) * std::cos(0.35 * north + 0.4);
          },
          {},
          test::Pattern(7, 0.5)};
}

class Sideways : public test::GlTest {
 protected:
  void SetUp() override {
    test::GlTest::SetUp();
    folder_ = std::filesystem::temp_directory_path() / fmt::format("overfly-sideways-{}", getpid());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    auto mapper = test::sceneMapper(context());
    std::uint64_t id = 0;
    for (const test::Photo& photo : test::photograph(hills(), 0.4)) {
      test::add(*mapper, test::frameOf(id, photo, static_cast<double>(id)));
      ++id;
    }
    MapMeta meta;
    meta.tile_size = kTile;
    meta.base_zoom = kZoom;
    meta.datum = capture::VerticalDatum::Ellipsoid;
    auto store = MapStore::create(folder_ / "map.overfly", meta);
    ASSERT_TRUE(store) << store.error().message;
    Batch batch;
    EncodeOptions options = encodeOptions(meta);
    auto encoded = encodeTile(test::finish(*mapper), options);
    ASSERT_TRUE(encoded) << encoded.error().message;
    batch.tiles.push_back(std::move(*encoded));
    ASSERT_TRUE(store->commit(batch));
  }
  void TearDown() override {
    std::filesystem::remove_all(folder_);
    test::GlTest::TearDown();
  }
  void exportTo(const std::filesystem::path& out, Layer layer) const {
    auto store = MapStore::open(folder_ / "map.overfly");
    ASSERT_TRUE(store) << store.error().message;
    auto reader = store->reader();
    ASSERT_TRUE(reader) << reader.error().message;
    ExportOptions options;
    options.layer = layer;
    const auto report = exportMap(*reader, out, options);
    ASSERT_TRUE(report) << report.error().message;
  }
  // East and north of a Web Mercator coordinate, metres in the scene's frame.
  static Eigen::Vector2d placeOf(double mercator_x, double mercator_y) {
    constexpr double kRadius = 6378137;
    const double lon = mercator_x / kRadius, lat = 2 * std::atan(std::exp(mercator_y / kRadius)) - M_PI / 2;
    return test::sceneFrame().local().enuFromEcef(geo::ecefFromGeodetic({lat, lon, kGround})).head<2>();
  }

  // A GeoTIFF by GDAL's own programs: the first band, and where its pixels lie.
  struct Raster {
    int width = 0, height = 0;
    std::array<double, 6> transform{};
    std::vector<double> value;
    [[nodiscard]] Eigen::Vector2d place(double x, double y) const {
      return placeOf(transform[0] + (x + 0.5) * transform[1], transform[3] + (y + 0.5) * transform[5]);
    }
  };
  static Raster read(const std::filesystem::path& tif) {
    Raster raster;
    const auto info = nlohmann::json::parse(outputOf(fmt::format("gdalinfo -json {}", tif.string())));
    raster.width = info["size"][0];
    raster.height = info["size"][1];
    raster.transform = info["geoTransform"].get<std::array<double, 6>>();
    const std::string raw = tif.string() + ".raw";
    outputOf(fmt::format("gdal_translate -q -b 1 -ot Float32 -of ENVI {} {}", tif.string(), raw));
    std::ifstream in(raw, std::ios::binary);
    std::vector<float> values(static_cast<std::size_t>(raster.width) *
                              static_cast<std::size_t>(raster.height));
    in.read(reinterpret_cast<char*>(values.data()),
            static_cast<std::streamsize>(values.size() * sizeof(float)));
    raster.value.assign(values.begin(), values.end());
    return raster;
  }

  static void expectInPlace(const char* name, const std::vector<double>& shifts) {
    ASSERT_GE(shifts.size(), 40u);
    std::printf("%s: shifted by %.3f texel in the median, %.3f at the 95th percentile of %zu blocks\n", name,
                quantile(shifts, 0.5), quantile(shifts, 0.95), shifts.size());
    EXPECT_LE(quantile(shifts, 0.5), 0.1);
    EXPECT_LE(quantile(shifts, 0.95), 0.3);
  }

  std::filesystem::path folder_;
};

TEST_F(Sideways, ColourAndHeightsOfAGeoTiffLieWhereTheTruthIs) {
  if (std::system("gdalinfo --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "gdal-bin is not installed";
  const test::Scene scene = hills();
  exportTo(folder_ / "color.tif", Layer::Color);
  const Raster color = read(folder_ / "color.tif");
  ASSERT_EQ(color.width, kTile);
  std::vector<double> luma;
  for (const double v : color.value) luma.push_back(v / 255);
  expectInPlace("colour, GeoTIFF", test::shiftsOf(luma, kTile, 16, [&](double x, double y) {
                  const Eigen::Vector2d p = color.place(x, y);
                  return scene.pattern.at(p.x(), p.y());
                }));

  exportTo(folder_ / "elevation.tif", Layer::Elevation);
  const Raster elevation = read(folder_ / "elevation.tif");
  ASSERT_EQ(elevation.width, kTile);
  std::vector<double> height;
  for (const double v : elevation.value) height.push_back(v - kGround);
  // Hills as long as these tell one figure for the whole tile.
  const std::vector<double> shifts = test::shiftsOf(height, kTile, kTile, [&](double x, double y) {
    const Eigen::Vector2d p = elevation.place(x, y);
    return scene.ground(p.x(), p.y()) - kGround;
  });
  ASSERT_EQ(shifts.size(), 1u);
  std::printf("heights, GeoTIFF: shifted by %.3f texel\n", shifts[0]);
  EXPECT_LE(shifts[0], 0.1);
}

TEST_F(Sideways, XyzTilesLieWhereTheirNumbersSay) {
  exportTo(folder_ / "xyz", Layer::Color);
  const geo::TileKey key = test::sceneFrame().key();
  std::filesystem::path file;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_ / "xyz"))
    if (entry.is_regular_file() &&
        entry.path().parent_path().string().ends_with(fmt::format("{}/{}", key.zoom, key.x)))
      file = entry.path();
  ASSERT_FALSE(file.empty());
  EXPECT_EQ(file.stem().string(), std::to_string(key.y));
  const cv::Mat image = cv::imread(file.string(), cv::IMREAD_COLOR);
  ASSERT_EQ(image.cols, kTile);
  std::vector<double> luma;
  for (int y = 0; y < kTile; ++y)
    for (int x = 0; x < kTile; ++x) luma.push_back(image.at<cv::Vec3b>(y, x)[1] / 255.0);
  constexpr double kWorld = 2 * M_PI * 6378137;
  const double side = kWorld / std::exp2(key.zoom);
  const test::Scene scene = hills();
  expectInPlace("colour, XYZ", test::shiftsOf(luma, kTile, 16, [&](double x, double y) {
                  const Eigen::Vector2d p =
                      placeOf(-kWorld / 2 + side * (static_cast<double>(key.x) + (x + 0.5) / kTile),
                              kWorld / 2 - side * (static_cast<double>(key.y) + (y + 0.5) / kTile));
                  return scene.pattern.at(p.x(), p.y());
                }));
}

}  // namespace
}  // namespace overfly::tiling
