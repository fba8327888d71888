#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "capture/frame_source.h"
#include "config/settings.h"
#include "daemon/overflyd/pipeline.h"
#include "render/gl/gl_thread.h"

namespace overfly::daemon {

// Of one mission: a folder below map.folder with one map and one recorded flight.
struct MissionInfo {
  std::string name;
  std::filesystem::path map;  // its file; made with the first frames
  std::int64_t started_utc_ns = 0;
  bool live = false;     // takes frames
  bool current = false;  // the one that the link shows: the live one, or the last one
};

// The missions of this machine. At most one takes frames. One that was ended is mapped to its end behind it,
// with what the GPU has left; one that a kill left unfinished is taken up again by resume().
//
// Thread rule: thread-safe. start() and stop() return within a second: the pipelines end in their own
// threads.
class Missions {
 public:
  // Makes the source anew for each mission. `on_commit`: some mission's map has changed.
  using MakeSource = std::function<Result<std::unique_ptr<capture::FrameSource>>()>;
  Missions(const config::Settings& settings, gl::GlThread& gl, MakeSource make_source,
           std::function<void()> on_commit);
  ~Missions();  // shutDown()
  Missions(const Missions&) = delete;
  Missions& operator=(const Missions&) = delete;

  // For tests (stage.h): of all pipelines begun from now on.
  void setStageHook(StageHook hook) { hook_ = std::move(hook); }
  void setGpuHook(GpuHook hook) { gpu_hook_ = std::move(hook); }

  // At the daemon's start: what was left unfinished goes on, the newest of it with the source. True: one is
  // live again.
  [[nodiscard]] Result<bool> resume();
  // A new mission, named by the time in UTC when `name` is empty. BadInput: one is live, the name is taken or
  // has other characters than letters, digits, '-', '_', '.'; the source's and the disk's errors.
  [[nodiscard]] Result<MissionInfo> start(const std::string& name = {});
  // No more frames for the live mission; what was recorded is mapped to its end. BadInput: none is live.
  [[nodiscard]] Result<void> stop();
  // For the autopilot's word: arming starts a mission, disarming ends it. Repeated words change nothing;
  // only with mission.start "arming".
  void armed(bool is_armed);

  // Newest last.
  [[nodiscard]] std::vector<MissionInfo> list() const;
  // The mission that the link shows; null: there is none yet.
  [[nodiscard]] std::shared_ptr<Pipeline> current() const;
  [[nodiscard]] std::string currentName() const;
  // All that run: the live one, and those that are mapped to their ends.
  [[nodiscard]] std::vector<std::shared_ptr<Pipeline>> running() const;

  // Writes down what has come to its end, and lets it go. Call it now and then. Returns the names.
  std::vector<std::string> tidy();
  // Settings that may change while running (config::Key::live).
  void reload(const config::Settings& settings);
  // Stops everything within 2 s, with what was made committed.
  void shutDown();

 private:
  struct Running {
    std::string name;
    std::shared_ptr<Pipeline> pipeline;
    bool live = false;
  };
  // With the mutex held.
  [[nodiscard]] Result<void> launch(const std::string& name, std::unique_ptr<capture::FrameSource> source,
                                    bool live);

  config::Settings settings_;
  gl::GlThread& gl_;
  MakeSource make_source_;
  std::function<void()> on_commit_;
  StageHook hook_;
  GpuHook gpu_hook_;
  mutable std::mutex mutex_;
  std::vector<Running> running_;
  std::shared_ptr<Pipeline> shown_;  // may have come to its end
  std::string shown_name_;
  // The folders, as of the last look: the link asks with every request.
  mutable std::vector<MissionInfo> listed_;
  mutable std::chrono::steady_clock::time_point looked_at_{};
};

// The folders below `root` that hold a map or a recorded flight, in the order in which they were begun.
[[nodiscard]] std::vector<std::string> missionsIn(const std::filesystem::path& root);

}  // namespace overfly::daemon
