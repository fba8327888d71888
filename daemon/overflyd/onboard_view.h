#pragma once
#include <filesystem>
#include <memory>
#include <mutex>

#include "config/settings.h"
#include "daemon/link/link_server.h"
#include "render/gl/gl_thread.h"

namespace overfly::daemon {

// Pictures of a map from any view point, drawn on the mapping's own GPU thread within the previews' share of
// it (preview.gpu_share). The tiles of the map that was asked for last stay in memory (preview.cache_mb, as
// much again on the GPU), and so do its photographs on the GPU, where some were asked for (34 MB).
// Thread-safe; one picture at a time.
class OnboardView {
 public:
  // The GL thread outlives it.
  OnboardView(const config::Preview& settings, gl::GlThread& gl);
  ~OnboardView();
  OnboardView(const OnboardView&) = delete;
  OnboardView& operator=(const OnboardView&) = delete;

  // Waits at most kPatience for tiles, then draws what is there. Unsupported: turned off; Unavailable: the
  // map has nothing to draw yet.
  [[nodiscard]] Result<link::PreviewPicture> draw(const std::filesystem::path& map,
                                                  const link::PreviewView& view);
  [[nodiscard]] link::PreviewLimits limits() const;
  void reload(const config::Preview& settings);

 private:
  struct Scene;
  [[nodiscard]] Result<void> open(const std::filesystem::path& map);
  [[nodiscard]] Result<void> openPhotographs();
  void close();

  gl::GlThread& gl_;
  mutable std::mutex settings_mutex_;
  config::Preview settings_;
  std::mutex mutex_;              // guards what is below
  std::unique_ptr<Scene> scene_;  // its GPU objects are used and destroyed on the GL thread
};

}  // namespace overfly::daemon
