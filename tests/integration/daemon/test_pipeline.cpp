#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "daemon/overflyd/options.h"
#include "daemon/overflyd/pipeline.h"
#include "tests/integration/daemon/daemon_process.h"
#include "tests/integration/daemon/pipeline_fixture.h"
#include "tiling/store/tile_codec.h"

// The pipeline within the test's process, with the mock camera.
namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;
using test::glThread;
using test::layersUnlikeAllFramesAtOnce;
using test::PipelineFolder;
using test::settingsHere;
using test::smokeSource;
using test::waitUntilMapped;

// A tile is a function of its frame set: whatever was swept when, and how often, and in spite of a stop in
// the middle, the map is that of all frames at once. Byte for byte, at a pace at which frames come between
// sweeps, and although a latency that cannot be kept makes the governor sweep at its fastest point first.
TEST(Pipeline, EndsWithTheMapOfAllFramesAtOnce) {
  if (test::smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  const PipelineFolder folder;
  config::Settings settings = settingsHere();
  settings.quality.latency_s = 0.05;
  const auto gl = glThread();
  {
    Pipeline first(settings, smokeSource(20), folder.path, *gl);
    ASSERT_TRUE(first.start());
    const auto cheap = [&] { return first.status().quality.to_improve; };
    for (int i = 0; i < 600 && cheap() == 0; ++i) std::this_thread::sleep_for(10ms);
    EXPECT_GT(cheap(), 0u);
    first.stop();
  }
  Pipeline pipeline(settings, smokeSource(20), folder.path, *gl);
  ASSERT_TRUE(pipeline.start());
  ASSERT_TRUE(waitUntilMapped(pipeline)) << pipeline.status().error;
  EXPECT_EQ(pipeline.status().quality.to_improve, 0u);
  pipeline.stop();

  EXPECT_EQ(layersUnlikeAllFramesAtOnce(pipeline.mapFile(), settings, *gl), 0u);
}

TEST(GpuHook, IsReadFromText) {
  for (const char* wrong :
       {"", "gpu", "gpu:", "gpu:lost", "gpu:lost@", "gpu:lost@0", "gpu:lost@x", "gpu:hot@3"})
    EXPECT_EQ(parseGpuHook(wrong).error().code, ErrorCode::BadSettings) << wrong;
  EXPECT_TRUE(parseGpuHook("gpu:lost@5"));
  EXPECT_TRUE(parseGpuHook("gpu:memory@5"));
}

// From what the drone itself knew (GPS, gimbal angles, a nominal lens) to a map with adjusted poses, frames
// handed on while others come, and what moved since mapped again.
TEST(Pipeline, AdjustsPosesThatAreTheDevicesOwn) {
  if (test::smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  const PipelineFolder folder;
  config::Settings settings = settingsHere();
  settings.adjust.mode = config::AdjustMode::Always;
  settings.map.folder = folder.path;
  const auto gl = glThread();
  const auto mission = folder.path / "mission";
  std::filesystem::create_directories(mission);
  Pipeline pipeline(settings, smokeSource(0, true), mission, *gl);
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
