#include "daemon/overflyd/options.h"

#include "capture/geo/geodetic.h"
#include "capture/replay/replay_source.h"
#include "daemon/overflyd/live.h"
#include "render/scene/scene_source.h"

namespace overfly::daemon {
namespace {

// A daemon that was not told its source yet: it shows its maps and waits for the setting.
class NoSource final : public capture::FrameSource {
 public:
  Result<void> open() override {
    return fail(ErrorCode::Unavailable, "source.path is empty: name a flight folder or a scene, and restart");
  }
  Result<capture::FramePtr> next(std::chrono::milliseconds) override { return capture::FramePtr{}; }
  void stop() override {}
  void close() override {}
  [[nodiscard]] std::string describe() const override { return "none"; }
};

}  // namespace

tiling::MapperOptions mapperOptions(const config::Settings& settings) {
  tiling::MapperOptions options;
  tiling::SweepOptions& sweep = options.sweep;
  switch (settings.sweep.cost) {
    case config::MatchingCost::Sad:
      sweep.cost = tiling::MatchCost::Sad;
      break;
    case config::MatchingCost::Ssd:
      sweep.cost = tiling::MatchCost::Ssd;
      break;
    case config::MatchingCost::Zncc:
      sweep.cost = tiling::MatchCost::Zncc;
      break;
    case config::MatchingCost::Census:
      sweep.cost = tiling::MatchCost::Census;
      break;
  }
  sweep.max_views = settings.sweep.images;
  sweep.window_radius = settings.sweep.window / 2;
  sweep.levels = settings.sweep.levels;
  sweep.regularise = settings.sweep.regularise > 0;
  sweep.min_score = settings.sweep.min_confidence;
  options.views.parallax_low = geo::radians(settings.sweep.min_parallax_deg);
  options.tile_size = settings.map.tile_size;
  options.hole_texels = settings.sweep.fill ? options.hole_texels : 0;
  options.frame_cache_bytes = static_cast<std::size_t>(settings.gpu.frame_cache_mb) << 20;
  return options;
}

tiling::SchedulerOptions schedulerOptions(const config::Settings& settings) {
  tiling::SchedulerOptions options;
  options.min_new_frames = settings.clipmap.min_new_frames;
  options.max_wait_s = settings.clipmap.max_wait_s;
  options.max_updates_per_s = settings.clipmap.max_updates_per_s;
  return options;
}

Result<std::unique_ptr<capture::FrameSource>> makeSource(const config::Settings& settings) {
  const config::Source& source = settings.source;
  const bool live = source.kind == config::SourceKind::V4l2 || source.kind == config::SourceKind::Libcamera;
  if (source.path.empty() && !live) return std::make_unique<NoSource>();
  switch (source.kind) {
    case config::SourceKind::Replay: {
      capture::ReplayOptions options;
      options.speed = source.speed;
      options.loop = source.loop;
      options.start = static_cast<std::size_t>(source.start_frame);
      return std::make_unique<capture::ReplaySource>(source.path, options);
    }
    case config::SourceKind::Scene: {
      scene::SceneSourceOptions options;
      options.speed = source.speed;
      return std::make_unique<scene::SceneSource>(source.path, options);
    }
    case config::SourceKind::V4l2:
    case config::SourceKind::Libcamera:
      break;
  }
  auto camera = makeCamera(settings);
  if (!camera) return tl::unexpected(camera.error());
  return makeLive(settings, std::move(*camera));
}

}  // namespace overfly::daemon
