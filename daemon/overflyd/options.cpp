#include "daemon/overflyd/options.h"

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

tiling::SchedulerOptions schedulerOptions(const config::Settings& settings) {
  tiling::SchedulerOptions options;
  options.growth = settings.clipmap.update_gain;
  options.settle_s = settings.clipmap.settle_s;
  options.max_wait_s = settings.clipmap.max_wait_s;
  options.max_updates_per_s = settings.clipmap.max_updates_per_s;
  return options;
}

tiling::adjust::LiveAdjustOptions adjustOptions(const config::Settings& settings) {
  const config::Adjust& adjust = settings.adjust;
  tiling::adjust::LiveAdjustOptions options;
  options.adjuster.map.window_frames = adjust.window_frames;
  options.adjuster.map.retained_frames = adjust.memory_frames;
  options.adjuster.map.gate_px = adjust.max_reprojection_px;
  options.adjuster.map.revise_px = adjust.remake_px;
  options.adjuster.features.most = adjust.features;
  options.max_wait_s = adjust.max_wait_s;
  if (adjust.keep_profile) options.profiles = deviceFolder(settings);
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
      options.import.raw = settings.adjust.mode == config::AdjustMode::Always;
      if (!settings.camera.model_file.empty()) options.import.camera_file = settings.camera.model_file;
      return std::make_unique<capture::ReplaySource>(source.path, options);
    }
    case config::SourceKind::Scene: {
      scene::SceneSourceOptions options;
      options.speed = source.speed;
      options.gpu.device = settings.gpu.device;
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
