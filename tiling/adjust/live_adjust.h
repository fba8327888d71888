#pragma once
#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "capture/frame.h"
#include "capture/record/flight.h"
#include "tiling/adjust/adjuster.h"

namespace overfly::tiling::adjust {

// Settings with the effect of raising them.
struct LiveAdjustOptions {
  AdjusterOptions adjuster;  // its map.revise_px: fewer tiles made again, less exact ones until landing
  double max_wait_s = 10;    // that a frame waits for its neighbours: better first poses, later first sight
  std::filesystem::path profiles;  // folder of the cameras' profiles (lens_profile.h); empty: none
};

// A frame that is to be mapped, or mapped again.
struct LiveFrame {
  FrameId id = 0;
  capture::Pose pose;
  capture::CameraModel camera;
  bool adjusted = false;      // false: the telemetry's pose, which is good enough for the sweep
  bool again = false;         // was handed on before with another pose
  std::int64_t since_ns = 0;  // when it arrived; again: when it was found to have moved
};

// The adjustment of a flight while it is mapped: decides when a frame is handed on, when it is handed on
// again because later evidence moved it, and what is held back.
//  - A frame is handed on when its window has closed, or when it has waited max_wait_s and has a pose that is
//    good enough for the sweep: adjusted so far, or the telemetry's. Else it is held back, with the reason,
//    until a later adjustment places it.
//  - A frame whose window has closed and that has moved by more than revise_px on the ground since it was
//    handed on is handed on again, in batches: when as many as a window holds have gathered, or the first of
//    them has waited max_wait_s, or at landing.
// Each camera is adjusted by itself. Nothing here reads a clock: `now_ns` is the caller's (any steady one).
// Thread rule: one thread.
class LiveAdjuster {
 public:
  explicit LiveAdjuster(const LiveAdjustOptions& options);
  ~LiveAdjuster();

  // `raw`: what the device wrote, where it did; else the frame's pose is what is known. `arrived_ns`: since
  // when the frame waits.
  [[nodiscard]] std::vector<LiveFrame> add(FrameId id, const capture::Frame& frame,
                                           const capture::TelemetryPtr& raw, std::int64_t arrived_ns,
                                           std::int64_t now_ns);
  // Frames that have waited long enough, and revisions that are due.
  [[nodiscard]] std::vector<LiveFrame> wait(std::int64_t now_ns);
  // No frame follows: closes all windows, adjusts all frames that are still held in memory together, writes
  // the cameras' profiles.
  [[nodiscard]] std::vector<LiveFrame> land();

  // What a person should know, since the last call.
  [[nodiscard]] std::vector<std::string> takeNotes();

  struct Status {
    std::uint64_t frames = 0;                        // that came
    std::uint64_t handed = 0;                        // on, for the first time
    std::uint64_t adjusted = 0;                      // of these: with an adjusted pose
    std::uint64_t revised = 0;                       // handed on again
    std::uint64_t batches = 0;                       // in which they were
    std::uint64_t waiting = 0;                       // for their neighbours
    std::map<std::string, std::uint64_t> held_back;  // at present, by reason
    double rms_px = 0;                               // of the last larger adjustment
  };
  [[nodiscard]] Status status() const;
  // The lens of a camera as calibrated so far; nullopt: no frame of it came.
  [[nodiscard]] std::optional<PoseMap::Summary> summaryOf(const std::string& camera_id) const;

 private:
  struct Camera;
  struct Known {
    std::string camera_id;
    std::int64_t arrived_ns = 0;
    bool handed = false;
  };

  [[nodiscard]] Camera& cameraOf(const capture::Frame& frame);
  void hold(FrameId id, const std::string& reason);
  void take(const std::vector<AdjustedPose>& poses, std::int64_t now_ns, std::vector<LiveFrame>& out);
  void handOn(const AdjustedPose& pose, std::vector<LiveFrame>& out);
  void handOnAgain(std::vector<LiveFrame>& out);

  LiveAdjustOptions options_;
  std::map<std::string, std::unique_ptr<Camera>> cameras_;
  std::map<FrameId, Known> known_;
  std::set<FrameId> waiting_;
  std::map<FrameId, std::string> held_;
  std::map<FrameId, AdjustedPose> moved_;  // since they were handed on
  std::int64_t moved_since_ns_ = 0;
  Status counts_;
  std::vector<std::string> notes_;
};

}  // namespace overfly::tiling::adjust
