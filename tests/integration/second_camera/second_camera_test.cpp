#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "capture/image_decode.h"
#include "capture/record/flight.h"
#include "capture/record/recorder.h"
#include "tests/integration/link/client.h"
#include "tests/integration/pull/mirror_check.h"
#include "tests/integration/pull/program.h"
#include "tests/shell.h"
#include "tiling/store/tile_codec.h"

// A map gets the pictures of a second camera as a layer of its own: from the command to the ground station.
namespace overfly::test {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using tiling::Layer;

class SecondCamera : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "overfly_second_camera_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  Outcome overfly(const std::string& arguments) {
    return shell("cd '" + folder_.string() + "' && LIBGL_ALWAYS_SOFTWARE=1 '" OVERFLY_PROGRAM "' " +
                 arguments);
  }
  // What a camera beside the first one takes: half as fine, one channel, dark where the first one sees
  // bright.
  void takeWithTheOther() {
    const auto flight = capture::Flight::open(folder_ / "flight");
    ASSERT_TRUE(flight) << flight.error().message;
    capture::FlightInfo info = flight->info();
    info.source = "the other camera";
    auto recorder = capture::FlightRecorder::create(folder_ / "other", info);
    ASSERT_TRUE(recorder) << recorder.error().message;
    for (std::size_t i = 0; i < flight->size(); ++i) {
      auto loaded = flight->load(i);
      ASSERT_TRUE(loaded) << loaded.error().message;
      capture::Frame frame = **loaded;
      auto image = capture::decodeImage(frame.image, capture::PixelFormat::Grey8, 2);
      ASSERT_TRUE(image) << image.error().message;
      for (std::uint8_t& value : image->bytes) value = static_cast<std::uint8_t>(255 - value);
      frame.camera = frame.camera.scaled(0.5);
      frame.camera.width = image->width;
      frame.camera.height = image->height;
      frame.image = std::move(*image);
      frame.camera_id = "other";
      frame.name.clear();
      const auto done = recorder->record(frame);
      ASSERT_TRUE(done) << done.error().message;
    }
    ASSERT_TRUE(recorder->close());
  }

  fs::path folder_;
};

// Correlation of one tile's luminance with another's red, moved by so many texels.
double correlation(const tiling::Tile& color, const tiling::Tile& other, int dx, int dy) {
  double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  for (int y = 2; y < color.size - 2; ++y)
    for (int x = 2; x < color.size - 2; ++x) {
      const auto p = static_cast<std::size_t>(y * color.size + x),
                 q = static_cast<std::size_t>((y + dy) * color.size + x + dx);
      if (color.color[4 * p + 3] == 0 || other.color[4 * q + 3] == 0) continue;
      const double u = 0.299 * color.color[4 * p] + 0.587 * color.color[4 * p + 1] +
                       0.114 * color.color[4 * p + 2],
                   v = other.color[4 * q];
      n += 1, a += u, b += v, aa += u * u, bb += v * v, ab += u * v;
    }
  return (ab - a * b / n) / std::sqrt((aa - a * a / n) * (bb - b * b / n));
}

TEST_F(SecondCamera, BecomesALayerOfTheMapThatIsServedPulledAndExported) {
  Outcome ran = overfly("simulate village --frames 6 --record flight");
  ASSERT_EQ(ran.status, 0) << ran.output;
  ran = overfly("map flight -o drone.overfly");
  ASSERT_EQ(ran.status, 0) << ran.output;
  ASSERT_NO_FATAL_FAILURE(takeWithTheOther());
  const auto before = tiling::MapReader::open(folder_ / "drone.overfly");
  ASSERT_TRUE(before);
  const auto meta = before->meta();
  ASSERT_TRUE(meta);
  const auto tiles = before->keys(meta->base_zoom, Layer::Color, {}, SIZE_MAX);
  ASSERT_TRUE(tiles);
  const auto whole_before = before->readWhole(tiles->at(tiles->size() / 2), tiling::kTileLayers);
  ASSERT_TRUE(whole_before);

  ran = overfly("map other --onto drone.overfly --layer thermal --json");
  ASSERT_EQ(ran.status, 0) << ran.output;

  // It lies where the orthophoto lies, upside down in brightness.
  const auto reader = tiling::MapReader::open(folder_ / "drone.overfly");
  ASSERT_TRUE(reader) << reader.error().message;
  const auto thermal = reader->keys(meta->base_zoom, Layer::Thermal, {}, SIZE_MAX);
  ASSERT_TRUE(thermal);
  EXPECT_GE(thermal->size() * 10, tiles->size() * 9);
  int compared = 0;
  double least = 1;
  for (const geo::TileKey& key : *thermal) {
    const auto color = tiling::readTile(*reader, key, tiling::only(Layer::Color)),
               other = tiling::readTile(*reader, key, tiling::only(Layer::Thermal));
    ASSERT_TRUE(color && other);
    std::size_t both = 0;
    for (std::size_t i = 0; i < color->texels(); ++i)
      both += color->color[4 * i + 3] != 0 && other->color[4 * i + 3] != 0 ? 1 : 0;
    if (both < color->texels() / 2) continue;
    const double here = -correlation(*color, *other, 0, 0);
    least = std::min(least, here);
    for (const auto& [dx, dy] : {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}})
      EXPECT_GT(here, -correlation(*color, *other, dx, dy)) << key.x << " " << key.y;
    ++compared;
  }
  std::printf("second camera: %d tiles, least correlation %.3f\n", compared, least);
  EXPECT_GE(compared, 4);
  EXPECT_GT(least, 0.8);
  const auto parents = reader->keys(meta->base_zoom - 1, Layer::Thermal, {}, SIZE_MAX);
  ASSERT_TRUE(parents);
  EXPECT_FALSE(parents->empty());
  // What was there has stayed as it was.
  const auto whole_after = reader->readWhole(tiles->at(tiles->size() / 2), tiling::kTileLayers);
  ASSERT_TRUE(whole_after);
  EXPECT_EQ(whole_after->info.frame_set, whole_before->info.frame_set);
  ASSERT_EQ(whole_after->layers.size(), whole_before->layers.size());
  for (std::size_t i = 0; i < whole_after->layers.size(); ++i)
    EXPECT_EQ(whole_after->layers[i].encoded.bytes, whole_before->layers[i].encoded.bytes);

  // On the link, in the mirror, in the export.
  Program server({OVERFLY_PROGRAM, "serve", folder_ / "drone.overfly", "--listen", "127.0.0.1:0", "--set",
                  "link.require_token=false"},
                 folder_ / "serve.err");
  std::string url = server.line(20s);
  ASSERT_TRUE(url.starts_with("http")) << url;
  while (!url.empty() && url.back() == '/') url.pop_back();
  const Answer list = fetch(url + "/tiles.json");
  EXPECT_NE(list.body.find("thermal"), std::string::npos) << list.body;
  const geo::TileKey& key = thermal->at(thermal->size() / 2);
  const Answer tile = fetch(url + "/tiles/thermal/" + std::to_string(key.zoom) + "/" + std::to_string(key.x) +
                            "/" + std::to_string(key.y) + ".webp");
  EXPECT_EQ(tile.status, 200) << tile.body;
  EXPECT_GT(tile.body.size(), 500u);
  ran = overfly("pull " + url + " mirror --once --give-up 60");
  EXPECT_EQ(ran.status, 0) << ran.output;
  expectSame(folder_ / "drone.overfly", folder_ / "mirror" / "drone.overfly");
  for (const char* file : {"thermal.tif", "thermal.mbtiles"}) {
    ran = overfly(std::string("export drone.overfly ") + file + " --layer thermal");
    EXPECT_EQ(ran.status, 0) << ran.output;
    ASSERT_TRUE(fs::exists(folder_ / file));
    EXPECT_GT(fs::file_size(folder_ / file), 10000u);
  }
}

TEST_F(SecondCamera, AnotherPlaceIsRefusedAndNothingIsWritten) {
  Outcome ran = overfly("simulate field --frames 3 --record flight");
  ASSERT_EQ(ran.status, 0) << ran.output;
  ran = overfly("map flight -o field.overfly");
  ASSERT_EQ(ran.status, 0) << ran.output;
  const auto size = fs::file_size(folder_ / "field.overfly");
  ran = overfly("simulate canyon --frames 3 --record elsewhere");
  ASSERT_EQ(ran.status, 0) << ran.output;
  ran = overfly("map elsewhere --onto field.overfly --layer near_infrared");
  EXPECT_EQ(ran.status, 1) << ran.output;
  EXPECT_NE(ran.output.find("it shows another place"), std::string::npos) << ran.output;
  EXPECT_EQ(fs::file_size(folder_ / "field.overfly"), size);
  // Half an instruction is none.
  EXPECT_EQ(overfly("map elsewhere --onto field.overfly").status, 2);
  EXPECT_EQ(overfly("map elsewhere -o new.overfly --layer thermal").status, 2);
}

}  // namespace
}  // namespace overfly::test
