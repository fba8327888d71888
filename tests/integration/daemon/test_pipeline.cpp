#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "capture/import/import_flight.h"
#include "capture/replay/replay_source.h"
#include "daemon/overflyd/options.h"
#include "daemon/overflyd/pipeline.h"
#include "tests/integration/daemon/daemon_process.h"
#include "tiling/mapping/mapper_settings.h"
#include "tiling/store/tile_codec.h"

// The pipeline within the test's process, with the mock camera.
namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;

std::unique_ptr<gl::GlThread> glThread() {
  auto made = gl::GlThread::start();
  if (!made) throw std::runtime_error(made.error().message);
  return std::move(*made);
}

struct Folder {
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "overfly_pipeline_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path = name;
  }
  ~Folder() { std::filesystem::remove_all(path); }
  std::filesystem::path path;
};

bool waitUntilMapped(const Pipeline& pipeline) {
  for (int i = 0; i < 3000; ++i) {
    const PipelineStatus status = pipeline.status();
    if (status.failed) return false;
    if (status.source_ended && status.idle) return true;
    std::this_thread::sleep_for(100ms);
  }
  return false;
}

// Whatever room the disk has.
config::Settings settingsHere() {
  config::Settings settings;
  settings.record.min_free_mb = settings.store.min_free_mb = 0;
  return settings;
}

std::unique_ptr<capture::FrameSource> smoke(double speed) {
  capture::ReplayOptions options;
  options.speed = speed;
  return std::make_unique<capture::ReplaySource>(test::smokeFlight(), options);
}

// A tile is a function of its frame set: whatever was swept when, and how often, and in spite of a stop in
// the middle, the map is that of all frames at once. Byte for byte, at a pace at which frames come between
// sweeps, and although a latency that cannot be kept makes the governor sweep at its fastest point first.
TEST(Pipeline, EndsWithTheMapOfAllFramesAtOnce) {
  if (test::smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  const Folder folder;
  config::Settings settings = settingsHere();
  settings.quality.latency_s = 0.05;
  const auto gl = glThread();
  {
    Pipeline first(settings, smoke(20), folder.path, *gl);
    ASSERT_TRUE(first.start());
    for (int i = 0; i < 600 && first.status().mapper.cells_swept < 3; ++i) std::this_thread::sleep_for(50ms);
    first.stop();
  }
  Pipeline pipeline(settings, smoke(20), folder.path, *gl);
  ASSERT_TRUE(pipeline.start());
  ASSERT_TRUE(waitUntilMapped(pipeline)) << pipeline.status().error;
  const QualityStatus quality = pipeline.status().quality;
  EXPECT_EQ(quality.index, 1u);
  EXPECT_EQ(quality.to_improve, 0u);
  pipeline.stop();

  auto reader = tiling::MapReader::open(pipeline.mapFile());
  ASSERT_TRUE(reader) << reader.error().message;
  const tiling::MapMeta meta = reader->meta().value();
  const auto g = nlohmann::json::parse(meta.extra)["ground"];
  tiling::MapGround ground;
  ground.base_zoom = g["base_zoom"];
  ground.gsd_m = g["gsd_m"];
  ground.texel_m = g["texel_m"];
  ground.height_m = g["height_m"];
  ground.min_height_m = g["min_height_m"];
  ground.max_height_m = g["max_height_m"];
  ground.anchor_px = g["anchor_px"];
  auto flight = capture::importFlight(test::smokeFlight());
  ASSERT_TRUE(flight) << flight.error().message;
  std::vector<tiling::Tile> expected;
  auto made = gl->submit(gl::Priority::Mapping, "batch", [&](gl::Context& context) -> Result<void> {
                  auto mapper = tiling::Mapper::create(context, tiling::mapperOptions(settings));
                  if (!mapper) return tl::unexpected(mapper.error());
                  (*mapper)->setGround(ground);
                  std::set<geo::TileKey> cells;
                  for (std::size_t i = 0; i < flight->size(); ++i) {
                    auto frame = flight->load(i);
                    if (!frame) return tl::unexpected(frame.error());
                    auto added = (*mapper)->addFrame(i, *frame, [&, i] { return flight->load(i); });
                    if (!added) return tl::unexpected(added.error());
                    cells.insert(added->begin(), added->end());
                  }
                  (void)(*mapper)->balanceExposure();
                  for (const geo::TileKey& cell : cells) {
                    auto tiles = (*mapper)->finishCell(cell);
                    if (!tiles) return tl::unexpected(tiles.error());
                    for (tiling::Tile& tile : *tiles) expected.push_back(std::move(tile));
                  }
                  return {};
                }).get();
  ASSERT_TRUE(made) << made.error().message;
  ASSERT_GT(expected.size(), 20u);
  EXPECT_EQ(reader->keys(meta.base_zoom, tiling::Layer::Color, {}, SIZE_MAX)->size(), expected.size());
  tiling::EncodeOptions encoding = tiling::encodeOptions(meta);
  encoding.color.quality = settings.store.color_quality;
  std::size_t different = 0;
  for (const tiling::Tile& tile : expected) {
    const auto stored = reader->readWhole(tile.key, tiling::kAllLayers);
    ASSERT_TRUE(stored) << stored.error().message;
    const auto whole = tiling::encodeTile(tile, encoding);
    ASSERT_TRUE(whole);
    EXPECT_EQ(stored->info.frame_set, whole->frame_set);
    ASSERT_EQ(stored->layers.size(), whole->layers.size());
    for (std::size_t i = 0; i < stored->layers.size(); ++i)
      different += stored->layers[i].encoded.bytes == whole->layers[i].bytes ? 0 : 1;
  }
  EXPECT_EQ(different, 0u);
}

// From what the drone itself knew (GPS, gimbal angles, a nominal lens) to a map with adjusted poses, frames
// handed on while others come, and what moved since mapped again.
TEST(Pipeline, AdjustsPosesThatAreTheDevicesOwn) {
  if (test::smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  const Folder folder;
  config::Settings settings = settingsHere();
  settings.adjust.mode = config::AdjustMode::Always;
  settings.map.folder = folder.path;
  const auto gl = glThread();
  capture::ReplayOptions options;
  options.speed = 0;
  options.import.raw = true;
  const auto mission = folder.path / "mission";
  std::filesystem::create_directories(mission);
  Pipeline pipeline(settings, std::make_unique<capture::ReplaySource>(test::smokeFlight(), options), mission,
                    *gl);
  ASSERT_TRUE(pipeline.start());
  ASSERT_TRUE(waitUntilMapped(pipeline)) << pipeline.status().error;
  const PipelineStatus status = pipeline.status();
  pipeline.stop();
  EXPECT_EQ(status.seen, 9u);
  EXPECT_EQ(status.mapped, 9u);
  EXPECT_EQ(status.adjust.adjusted, 9u);
  EXPECT_TRUE(status.adjust.held_back.empty());
  EXPECT_LT(status.adjust.rms_px, 0.6);
  auto reader = tiling::MapReader::open(pipeline.mapFile());
  ASSERT_TRUE(reader) << reader.error().message;
  const auto keys = reader->keys(reader->meta()->base_zoom, tiling::Layer::Elevation, {}, SIZE_MAX);
  ASSERT_TRUE(keys);
  std::size_t texels = 0, heights = 0;
  for (const geo::TileKey& key : *keys) {
    auto tile = tiling::readTile(*reader, key);
    ASSERT_TRUE(tile);
    for (std::size_t i = 0; i < tile->texels(); ++i) {
      texels += tile->color[4 * i + 3] != 0 ? 1 : 0;
      heights += tile->color[4 * i + 3] != 0 && tile->kind[i] == tiling::kMeasured ? 1 : 0;
    }
  }
  // With the poses that the flight was adjusted to by others it is 0.48, with the raw ones 0.28, and those
  // wrong.
  EXPECT_GT(static_cast<double>(heights), 0.38 * static_cast<double>(texels));
}

// A slow stage makes the others wait or put off, never lose: the queues are bounded, and frames wait on disk.
TEST(Pipeline, SlowStagesLoseNothing) {
  if (test::smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  const auto gl = glThread();
  for (const Stage slow : {Stage::Mapping, Stage::Encoding}) {
    const Folder folder;
    Pipeline pipeline(settingsHere(), smoke(0), folder.path, *gl);
    pipeline.setStageHook([slow](Stage stage, std::uint64_t) {
      if (stage == slow) std::this_thread::sleep_for(30ms);
    });
    ASSERT_TRUE(pipeline.start());
    ASSERT_TRUE(waitUntilMapped(pipeline)) << pipeline.status().error;
    EXPECT_EQ(pipeline.status().mapped, 9u);
    EXPECT_TRUE(pipeline.status().stuck.empty());
  }
}

TEST(StageHook, IsReadFromText) {
  for (const char* wrong : {"", "mapping", "mapping:", "nobody:stuck", "mapping:slow", "mapping:slow:x",
                            "mapping:throw@", "mapping:throw@x", "capture:gone"})
    EXPECT_EQ(parseStageHook(wrong).error().code, ErrorCode::BadSettings) << wrong;
  const auto hook = parseStageHook("encoding:throw@3");
  ASSERT_TRUE(hook);
  EXPECT_NO_THROW((*hook)(Stage::Encoding, 2));
  EXPECT_NO_THROW((*hook)(Stage::Mapping, 3));
  EXPECT_THROW((*hook)(Stage::Encoding, 3), std::runtime_error);
  EXPECT_TRUE(parseStageHook("capture:slow:5"));
}

TEST(Heartbeat, IsSilentUntilItsOwnThreadBeatsAgain) {
  Heartbeat heart;
  EXPECT_LT(heart.silence(), 0ms);  // it has not begun
  heart.beat();
  std::this_thread::sleep_for(30ms);
  EXPECT_GE(heart.silence(), 30ms);
  heart.excuse();
  EXPECT_LT(heart.silence(), 0ms);
  heart.beat();
  EXPECT_GE(heart.silence(), 0ms);
}

TEST(Latency, MedianAndTailOfTheLastFrames) {
  Latency latency;
  EXPECT_EQ(latency.summary().frames, 0u);
  for (int i = 100; i >= 0; --i) latency.add(i);
  EXPECT_EQ(latency.summary().frames, 101u);
  EXPECT_EQ(latency.summary().median, 50);
  EXPECT_EQ(latency.summary().p95, 95);
  EXPECT_EQ(latency.summary().last, 0);
  for (std::size_t i = 0; i < Latency::kKept; ++i) latency.add(7);
  EXPECT_EQ(latency.summary().p95, 7);
}

}  // namespace
}  // namespace overfly::daemon
