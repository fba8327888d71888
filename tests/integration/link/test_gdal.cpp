#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "daemon/link/link_server.h"
#include "tests/integration/link/client.h"
#include "tests/integration/link/made_map.h"

// GDAL's own programs and drivers against the live map and its exports, at places where signs and zones go
// wrong.
namespace overfly::test {
namespace {

struct Place {
  const char* name;
  double lat, lon;
  int utm_epsg;
};

std::string output(const std::string& command) {
  std::string out;
  std::FILE* pipe = popen((command + " 2>/dev/null").c_str(), "r");
  std::array<char, 4096> block{};
  while (const auto size = std::fread(block.data(), 1, block.size(), pipe)) out.append(block.data(), size);
  pclose(pipe);
  return out;
}

class Gdal : public testing::TestWithParam<Place> {
 protected:
  void SetUp() override {
    if (output("gdalinfo --version").empty()) GTEST_SKIP() << "gdal-bin is not installed";
    std::string pattern = std::filesystem::temp_directory_path() / "overfly-gdal-XXXXXX";
    folder_ = mkdtemp(pattern.data());
    // Else GDAL's drivers leave their tiles in the folder that the tests run in.
    setenv("GDAL_DEFAULT_WMS_CACHE_PATH", (folder_ / "gdal-cache").c_str(), 1);
    const auto lattice = geo::TileLattice::webMercator();
    const auto plane = lattice.planeFromGeodetic(geo::radians(GetParam().lat), geo::radians(GetParam().lon));
    auto corner = geo::TileLattice::keyAt(*plane, 18);
    // the place lies in the middle of the map, so that a zone's edge goes through it
    --corner.x;
    --corner.y;
    map_ = std::make_unique<MadeMap>(folder_ / "made.overfly", corner, 2);
    map_->makeAll();
    link::LinkOptions options;
    options.port = 0;
    server_ = std::make_unique<link::LinkServer>(
        options, link::showMaps({{"made", "Made-up map", map_->path(), 0, false, true}}));
    ASSERT_TRUE(server_->start());
    base_ = fmt::format("http://127.0.0.1:{}", server_->port());
  }
  void TearDown() override {
    server_.reset();
    map_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  // The map's edges in EPSG:3857: west, north, east, south.
  [[nodiscard]] std::array<double, 4> edges() const {
    constexpr double kHalf = 20037508.342789244;
    const double cell = 2 * kHalf / (1 << 18);
    const auto& c = map_->corner();
    const auto x = static_cast<double>(c.x), y = static_cast<double>(c.y);
    return {x * cell - kHalf, kHalf - y * cell, (x + 2) * cell - kHalf, kHalf - (y + 2) * cell};
  }
  [[nodiscard]] double trueHeight(double lat, double lon) const {
    const auto plane =
        geo::TileLattice::webMercator().planeFromGeodetic(geo::radians(lat), geo::radians(lon));
    return static_cast<double>(MadeMap::heightAt(plane->x(), plane->y()));
  }

  std::filesystem::path folder_;
  std::unique_ptr<MadeMap> map_;
  std::unique_ptr<link::LinkServer> server_;
  std::string base_;
};

TEST_P(Gdal, WmtsAndTmsDriversReadTheLiveMapAtItsPlace) {
  const auto centre = map_->centre();
  const auto at = fmt::format("{:.8f} {:.8f}", geo::degrees(centre.lon), geo::degrees(centre.lat));
  const auto wmts = fmt::format("'WMTS:{}/wmts/1.0.0/WMTSCapabilities.xml,layer=color'", base_);
  const auto info = nlohmann::json::parse(output("gdalinfo -json " + wmts), nullptr, false);
  ASSERT_TRUE(info.is_object());
  const auto [west, north, east, south] = edges();
  const auto corners = info["cornerCoordinates"];
  EXPECT_NEAR(corners["upperLeft"][0].get<double>(), west, 1);
  EXPECT_NEAR(corners["upperLeft"][1].get<double>(), north, 1);
  EXPECT_NEAR(corners["lowerRight"][0].get<double>(), east, 1);
  EXPECT_NEAR(corners["lowerRight"][1].get<double>(), south, 1);

  const auto tms = folder_ / "tms.xml";
  std::ofstream(tms)
      << "<GDAL_WMS><Service name=\"TMS\"><ServerUrl>" << base_
      << "/tiles/color/${z}/${x}/${y}.png</ServerUrl></Service><DataWindow>"
         "<UpperLeftX>-20037508.342789244</UpperLeftX><UpperLeftY>20037508.342789244</UpperLeftY>"
         "<LowerRightX>20037508.342789244</LowerRightX><LowerRightY>-20037508.342789244</LowerRightY>"
         "<TileLevel>18</TileLevel><TileCountX>1</TileCountX><TileCountY>1</TileCountY>"
         "<YOrigin>top</YOrigin></DataWindow><Projection>EPSG:3857</Projection>"
         "<BlockSizeX>256</BlockSizeX><BlockSizeY>256</BlockSizeY><BandsCount>4</BandsCount>"
         "</GDAL_WMS>";
  const auto by_tms = output("gdallocationinfo -wgs84 -valonly " + tms.string() + " " + at);
  EXPECT_EQ(std::count(by_tms.begin(), by_tms.end(), '\n'), 4) << by_tms;
  EXPECT_TRUE(by_tms.ends_with("255\n")) << by_tms;
  // The picture's own server and two drivers agree about the pixel there.
  EXPECT_EQ(output("gdallocationinfo -wgs84 -valonly " + wmts + " " + at), by_tms);
}

TEST_P(Gdal, ExportsLieWhereTheMapDoesWithItsHeights) {
  const auto centre = map_->centre();
  const double lat = geo::degrees(centre.lat), lon = geo::degrees(centre.lon);
  for (const auto& [file, options] :
       {std::pair<std::string, std::string>{"utm.tif", "--utm"}, {"web.tif", "--webmercator"}}) {
    SCOPED_TRACE(file);
    const auto out = (folder_ / file).string();
    ASSERT_EQ(std::system(fmt::format("{}/bin/overfly export {} {} --layer elevation {} >/dev/null 2>&1",
                                      OVERFLY_BINARY_DIR, map_->path().string(), out, options)
                              .c_str()),
              0);
    const auto info = nlohmann::json::parse(output("gdalinfo -json " + out), nullptr, false);
    ASSERT_TRUE(info.is_object());
    const auto wkt = info["coordinateSystem"]["wkt"].get<std::string>();
    if (file == "utm.tif") {
      EXPECT_NE(wkt.find(fmt::format("ID[\"EPSG\",{}]", GetParam().utm_epsg)), std::string::npos) << wkt;
    }
    // Points some metres to each side of the middle, and so of a zone's edge.
    for (const auto& [dlat, dlon] :
         {std::pair{0.0, 0.0002}, {0.0, -0.0002}, {0.0002, 0.0001}, {-0.0002, -0.0001}}) {
      // By way of its input, since it takes a negative number for an option.
      const auto plain = output(fmt::format("echo {:.8f} {:.8f} | gdallocationinfo -wgs84 -valonly {}",
                                            lon + dlon, lat + dlat, out));
      EXPECT_NEAR(std::strtod(plain.c_str(), nullptr), trueHeight(lat + dlat, lon + dlon), 0.5) << plain;
    }
  }
}

// 33.9 S, where north and south may be swapped; the edge between zones 33 and 34 at 18 E; the antimeridian's
// side.
INSTANTIATE_TEST_SUITE_P(Places, Gdal,
                         testing::Values(Place{"CapeTown", -33.9, 18.43, 32734},
                                         Place{"ZoneEdge", 51.2, 18.0, 32633},
                                         Place{"WestOfGreenwich", 40.4, -3.7, 32630}),
                         [](const auto& one) { return std::string(one.param.name); });

}  // namespace
}  // namespace overfly::test
