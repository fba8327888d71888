#include "tests/integration/daemon/pipeline_fixture.h"

#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <thread>

#include "capture/import/import_flight.h"
#include "capture/replay/replay_source.h"
#include "tests/integration/daemon/daemon_process.h"
#include "tiling/mapping/mapper_settings.h"
#include "tiling/store/tile_codec.h"

namespace overfly::test {

std::unique_ptr<gl::GlThread> glThread() {
  auto made = gl::GlThread::start();
  if (!made) throw std::runtime_error(made.error().message);
  return std::move(*made);
}

PipelineFolder::PipelineFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "overfly_pipeline_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
  path = name;
}

PipelineFolder::~PipelineFolder() {
  std::error_code code;
  std::filesystem::remove_all(path, code);
}

config::Settings settingsHere() {
  config::Settings settings;
  settings.record.min_free_mb = settings.store.min_free_mb = 0;
  return settings;
}

std::unique_ptr<capture::FrameSource> smokeSource(double speed, bool raw) {
  capture::ReplayOptions options;
  options.speed = speed;
  options.import.raw = raw;
  return std::make_unique<capture::ReplaySource>(smokeFlight(), options);
}

bool waitUntilMapped(const daemon::Pipeline& pipeline) {
  for (int i = 0; i < 3000; ++i) {
    const daemon::PipelineStatus status = pipeline.status();
    if (status.failed) return false;
    if (status.source_ended && status.idle) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return false;
}

std::size_t layersUnlikeAllFramesAtOnce(const std::filesystem::path& map, const config::Settings& settings,
                                        gl::GlThread& gl) {
  auto reader = tiling::MapReader::open(map);
  if (!reader) return SIZE_MAX;
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
  if (!flight) return SIZE_MAX;
  std::vector<tiling::Tile> expected;
  auto made = gl.submit(gl::Priority::Mapping, "batch", [&](gl::Context& context) -> Result<void> {
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
  if (!made || expected.size() <= 20) return SIZE_MAX;
  const std::size_t stored_tiles = reader->keys(meta.base_zoom, tiling::Layer::Color, {}, SIZE_MAX)->size();
  if (stored_tiles > expected.size()) return SIZE_MAX;
  tiling::EncodeOptions encoding = tiling::encodeOptions(meta);
  encoding.color.quality = settings.store.color_quality;
  std::size_t different = 0;
  for (const tiling::Tile& tile : expected) {
    const auto stored = reader->readWhole(tile.key, tiling::kAllLayers);
    const auto whole = tiling::encodeTile(tile, encoding);
    if (!whole) return SIZE_MAX;
    if (!stored || stored->info.frame_set != whole->frame_set ||
        stored->layers.size() != whole->layers.size()) {
      different += whole->layers.size();
      continue;
    }
    for (std::size_t i = 0; i < stored->layers.size(); ++i)
      different += stored->layers[i].encoded.bytes == whole->layers[i].bytes ? 0 : 1;
  }
  return different;
}

}  // namespace overfly::test
