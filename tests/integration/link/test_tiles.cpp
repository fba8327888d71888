#include <png.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "tests/integration/link/served_map.h"
#include "tiling/store/tile_codec.h"

namespace overfly::test {
namespace {

using Tiles = ServedMap;

TEST_F(Tiles, ColourIsTheStoredFileByteForByte) {
  map_->makeAll();
  serve();
  const auto reader = map_->store().reader();
  ASSERT_TRUE(reader);
  int compared = 0;
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 4; ++x) {
      const auto stored = reader->read(cell(x, y), tiling::Layer::Color);
      ASSERT_TRUE(stored);
      const auto answer = fetch(base_ + tilePath("color", cell(x, y), "webp"));
      ASSERT_EQ(answer.status, 200);
      EXPECT_EQ(answer.headers.at("content-type"), tiling::mediaType(stored->encoded.codec));
      EXPECT_EQ(answer.headers.at("cache-control"), "no-cache");
      ASSERT_EQ(answer.body, std::string(stored->encoded.bytes.begin(), stored->encoded.bytes.end()));
      ++compared;
    }
  EXPECT_EQ(compared, 16);
}

TEST_F(Tiles, GeoTiffHoldsTheStoredHeightsAndTheHoles) {
  map_->makeAll();
  serve();
  const auto key = cell(0, 0);  // on the rim: half of it is a hole
  const auto reader = map_->store().reader();
  const auto tile = tiling::readTile(*reader, key, tiling::only(tiling::Layer::Elevation));
  ASSERT_TRUE(tile);
  const auto answer = fetch(base_ + tilePath("elevation", key, "tif"));
  ASSERT_EQ(answer.status, 200);
  ASSERT_GT(answer.body.size(), 256u * 256 * 4);
  std::vector<float> heights(256 * 256);
  std::memcpy(heights.data(), answer.body.data() + (answer.body.size() - 256 * 256 * 4), 256 * 256 * 4);
  int holes = 0;
  for (std::size_t i = 0; i < heights.size(); ++i) {
    ASSERT_EQ(std::isnan(heights[i]), std::isnan(tile->elevation[i]));
    if (std::isnan(heights[i])) {
      ++holes;
    } else {
      ASSERT_EQ(heights[i], tile->elevation[i]);
    }
  }
  EXPECT_GT(holes, 0);
  EXPECT_LT(holes, 256 * 256);
}

TEST_F(Tiles, EveryLayerAndFormatAnswersAndUnknownOnesDoNot) {
  map_->makeAll();
  map_->addFrames(10);
  serve();
  const auto key = cell(1, 1);
  for (const auto& [layer, extension, magic] :
       std::vector<std::array<std::string, 3>>{{"color", "png", "\x89PNG"},
                                               {"color", "jpg", "\xff\xd8"},
                                               {"elevation", "png", "\x89PNG"},
                                               {"elevation", "webp", "RIFF"},
                                               {"elevation", "tif", "II*"},
                                               {"hillshade", "png", "\x89PNG"},
                                               {"quality", "png", "\x89PNG"},
                                               {"coverage", "png", "\x89PNG"}}) {
    const auto answer = fetch(base_ + tilePath(layer, key, extension));
    EXPECT_EQ(answer.status, 200) << layer << " " << extension;
    EXPECT_TRUE(answer.body.starts_with(magic)) << layer << " " << extension;
  }
  for (const auto* bad : {"/tiles/color/18/1/1.tif", "/tiles/nothing/1/0/0.png", "/tiles/color/99/0/0.png",
                          "/tiles/coverage/1/0/0.jpg", "/nothing", "/m/none/tiles/color/1/0/0.png"})
    EXPECT_EQ(fetch(base_ + bad).status, 404) << bad;
  EXPECT_EQ(fetch(base_ + "/tiles.json", {}, "POST", "x").status, 405);
}

TEST_F(Tiles, EtagFollowsTheRevisionAlsoFromEmptyToFilled) {
  map_->make({{0, 0}});
  serve();
  const auto url = base_ + tilePath("color", cell(2, 2), "webp");
  // (2, 2) is interpolated from its ancestor or empty; either way it has a tag that must change when it is
  // made
  const auto before = fetch(url);
  ASSERT_EQ(before.status, 200);
  const auto tag = before.headers.at("etag");
  EXPECT_FALSE(tag.starts_with("W/"));
  EXPECT_EQ(fetch(url, {"If-None-Match: " + tag}).status, 304);
  map_->make({{2, 2}});
  const auto after = fetch(url, {"If-None-Match: " + tag});
  EXPECT_EQ(after.status, 200);
  EXPECT_NE(after.headers.at("etag"), tag);
  EXPECT_EQ(fetch(url, {"If-None-Match: " + after.headers.at("etag")}).status, 304);

  // a neighbour's change leaves colour alone and reaches the hillshade's border
  const auto shade = base_ + tilePath("hillshade", cell(2, 2), "png");
  const auto shade_tag = fetch(shade).headers.at("etag");
  map_->make({{3, 2}}, 1);
  EXPECT_EQ(fetch(url, {"If-None-Match: " + after.headers.at("etag")}).status, 304);
  EXPECT_EQ(fetch(shade, {"If-None-Match: " + shade_tag}).status, 200);
}

TEST_F(Tiles, CoarserAndFinerZoomsAreComposed) {
  map_->makeAll();
  serve();
  const auto top =
      geo::parentOf(geo::parentOf(geo::parentOf(cell(0, 0))));  // zoom 15: one above the coarsest
  const auto coarse = fetch(base_ + tilePath("color", top, "png"));
  const auto empty = fetch(base_ + "/tiles/color/15/1/1.png");
  ASSERT_EQ(coarse.status, 200);
  EXPECT_NE(coarse.body, empty.body);
  EXPECT_TRUE(empty.headers.at("etag").starts_with("\"0-"));
  const auto fine = fetch(base_ + tilePath("color", geo::childOf(cell(1, 1), 3), "png"));
  EXPECT_FALSE(fine.headers.at("etag").starts_with("\"0-"));
}

TEST_F(Tiles, LargeStoredTilesAreCutTo256) {
  map_.reset();
  std::filesystem::remove(folder_ / "made.overfly");
  map_ = std::make_unique<MadeMap>(folder_ / "made.overfly", geo::TileKey{18, 137000, 87000}, 2, 512);
  map_->makeAll();
  serve();
  const auto reader = map_->store().reader();
  const auto tile = tiling::readTile(*reader, cell(0, 0), tiling::only(tiling::Layer::Elevation));
  ASSERT_TRUE(tile);
  const auto answer = fetch(base_ + tilePath("elevation", geo::childOf(cell(0, 0), 3), "tif"));
  ASSERT_EQ(answer.status, 200);
  std::vector<float> heights(256 * 256);
  std::memcpy(heights.data(), answer.body.data() + (answer.body.size() - 256 * 256 * 4), 256 * 256 * 4);
  for (std::size_t y = 0; y < 256; ++y)
    for (std::size_t x = 0; x < 256; ++x)
      ASSERT_EQ(heights[y * 256 + x], tile->elevation[(y + 256) * 512 + x + 256]);
  const auto document = nlohmann::json::parse(fetch(base_ + "/tiles/color.json").body);
  EXPECT_EQ(document["maxzoom"], 19);
}

// The shade's strength (alpha) of a hillshade PNG, row by row, by libpng.
std::vector<std::uint8_t> shadeOf(const std::string& file) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_memory(&image, file.data(), file.size())) return {};
  image.format = PNG_FORMAT_RGBA;
  std::vector<std::uint8_t> rgba(PNG_IMAGE_SIZE(image));
  if (!png_image_finish_read(&image, nullptr, rgba.data(), 0, nullptr)) return {};
  std::vector<std::uint8_t> out;
  for (std::size_t i = 3; i < rgba.size(); i += 4) out.push_back(rgba[i]);
  return out;
}

// How far the pixel at `i` lies from the line through its neighbours: large at a seam, small on smooth
// ground.
double bend(const std::vector<double>& line, std::size_t i) {
  return std::abs(line[i] - 0.5 * (line[i - 1] + line[i + 1]));
}

TEST_F(Tiles, HillshadeHasNoSeam) {
  map_->makeAll();
  serve();
  const auto shade = [&](int x, int y) {
    return shadeOf(fetch(base_ + tilePath("hillshade", cell(x, y), "png")).body);
  };
  const auto middle = shade(1, 1), east = shade(2, 1), south = shade(1, 2);
  ASSERT_EQ(middle.size(), 256u * 256);
  ASSERT_EQ(east.size(), middle.size());
  ASSERT_EQ(south.size(), middle.size());
  // Pixels across the edge, against the same measure everywhere beside it: a slope taken without the
  // neighbour's heights is half of the true one or none, and bends the shading at the edge alone.
  double at_edge = 0, beside = 0, spread = 0;
  for (std::size_t k = 0; k < 256; ++k) {
    std::vector<double> across_east, across_south;
    for (std::size_t i = 192; i < 256; ++i) {
      across_east.push_back(middle[k * 256 + i]);
      across_south.push_back(middle[i * 256 + k]);
    }
    for (std::size_t i = 0; i < 64; ++i) {
      across_east.push_back(east[k * 256 + i]);
      across_south.push_back(south[i * 256 + k]);
    }
    for (const auto& line : {across_east, across_south}) {
      for (std::size_t i = 1; i + 1 < line.size(); ++i) {
        double& worst = i == 63 || i == 64 ? at_edge : beside;
        worst = std::max(worst, bend(line, i));
        spread = std::max(spread, std::abs(line[i] - line[0]));
      }
    }
  }
  EXPECT_GT(spread, 40) << "the ground is too flat to show a seam";
  EXPECT_LE(at_edge, beside + 1);
}

TEST_F(Tiles, DocumentsTellTheTruth) {
  const auto revision = map_->makeAll();
  serve();
  const auto document = nlohmann::json::parse(fetch(base_ + "/tiles/elevation.json").body);
  EXPECT_EQ(document["tilejson"], "3.0.0");
  EXPECT_EQ(document["minzoom"], 16);
  EXPECT_EQ(document["maxzoom"], 18);
  EXPECT_EQ(document["revision"], revision);
  EXPECT_EQ(document["encoding"], "terrarium");
  EXPECT_EQ(document["vertical_datum"], "ellipsoid");
  const double west = 137000.0 / (1 << 18) * 360 - 180, east = 137004.0 / (1 << 18) * 360 - 180;
  EXPECT_NEAR(document["bounds"][0].get<double>(), west, 1e-9);
  EXPECT_NEAR(document["bounds"][2].get<double>(), east, 1e-9);
  const auto wmts = fetch(base_ + "/wmts?service=WMTS&request=GetCapabilities");
  EXPECT_EQ(wmts.status, 200);
  EXPECT_NE(wmts.body.find("<ows:Identifier>color</ows:Identifier>"), std::string::npos);
  const auto kvp = fetch(base_ +
                         "/wmts?SERVICE=WMTS&REQUEST=GetTile&LAYER=color&TILEMATRIX=18&TILECOL=137001&"
                         "TILEROW=87001&FORMAT=image/webp");
  EXPECT_EQ(kvp.body, fetch(base_ + tilePath("color", cell(1, 1), "webp")).body);
}

TEST_F(Tiles, HeightIsTheMapsAtThatPlace) {
  map_->makeAll();
  serve();
  const auto centre = map_->centre();
  const auto lat = std::to_string(geo::degrees(centre.lat)), lon = std::to_string(geo::degrees(centre.lon));
  const auto answer = fetch(base_ + "/height?lat=" + lat + "&lon=" + lon);
  ASSERT_EQ(answer.status, 200) << answer.body;
  const auto node = nlohmann::json::parse(answer.body);
  const auto plane = geo::TileLattice::webMercator().planeFromGeodetic(geo::radians(std::stod(lat)),
                                                                       geo::radians(std::stod(lon)));
  EXPECT_NEAR(node["height_m"].get<double>(), MadeMap::heightAt(plane->x(), plane->y()),
              0.1);  // half a texel of its steepest slope
  EXPECT_EQ(node["datum"], "ellipsoid");
  EXPECT_GT(node["accuracy_m"].get<double>(), 0);
  EXPECT_EQ(node["views"], 5);
  EXPECT_EQ(fetch(base_ + "/height?lat=1&lon=1").status, 404);
  EXPECT_EQ(fetch(base_ + "/height?lat=91&lon=1").status, 400);
  EXPECT_EQ(fetch(base_ + "/height?lat=x").status, 400);
}

}  // namespace
}  // namespace overfly::test
