#include "tiling/adjust/live_adjust.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "capture/image_decode.h"
#include "tiling/adjust/lens_profile.h"
#include "tiling/adjust/telemetry_prior.h"

namespace overfly::tiling::adjust {
namespace {

constexpr std::size_t kCourseFrames = 4;  // that are looked back on for the course over ground

}  // namespace

struct LiveAdjuster::Camera {
  std::string id;
  capture::CameraModel nominal;  // of its first frame, or the profile's
  AdjustOptions map_options;
  std::unique_ptr<Adjuster> adjuster;
  std::deque<capture::FlightFrame> last;  // telemetry of the last frames, for the course
  std::uint64_t frames = 0;
};

LiveAdjuster::LiveAdjuster(const LiveAdjustOptions& options) : options_(options) {}
LiveAdjuster::~LiveAdjuster() = default;

LiveAdjuster::Camera& LiveAdjuster::cameraOf(const capture::Frame& frame) {
  auto& slot = cameras_[frame.camera_id];
  if (slot) return *slot;
  slot = std::make_unique<Camera>();
  slot->id = frame.camera_id;
  slot->nominal = frame.camera;
  AdjusterOptions options = options_.adjuster;
  if (!options_.profiles.empty()) {
    const auto profile = readLensProfile(options_.profiles / lensProfileName(frame.camera_id));
    if (profile && fits(*profile, frame.camera)) {
      slot->nominal = profile->camera;
      options.map = startingFrom(*profile, options.map);
      notes_.push_back(fmt::format("camera {}: begins from its profile (f {:.1f} +- {:.1f} pixels)",
                                   frame.camera_id, profile->camera.fx, (*options.map.sigma_lens)[0]));
    } else if (!profile && profile.error().code != ErrorCode::NotFound) {
      notes_.push_back(profile.error().message);
    }
  }
  slot->map_options = options.map;
  slot->adjuster = std::make_unique<Adjuster>(slot->nominal, options);
  return *slot;
}

void LiveAdjuster::hold(FrameId id, const std::string& reason) {
  waiting_.erase(id);
  // Counted by kind: what stands behind the colon is of this frame alone.
  held_[id] = reason.substr(0, reason.find(':'));
}

std::vector<LiveFrame> LiveAdjuster::add(FrameId id, const capture::Frame& frame,
                                         const capture::TelemetryPtr& raw, std::int64_t arrived_ns,
                                         std::int64_t now_ns) {
  std::vector<LiveFrame> out;
  if (!known_.try_emplace(id, Known{frame.camera_id, arrived_ns, false}).second) return out;
  ++counts_.frames;
  Camera& camera = cameraOf(frame);
  ++camera.frames;
  std::optional<capture::Pose> prior;
  if (raw) {
    capture::FlightFrame entry;
    entry.frame.time_ns = frame.time_ns;
    entry.raw = raw;
    camera.last.push_back(std::move(entry));
    while (camera.last.size() > kCourseFrames) camera.last.pop_front();
    const std::vector<capture::FlightFrame> last(camera.last.begin(), camera.last.end());
    prior = priorsFromTelemetry(last).back().pose;
  }
  if (!prior && frame.pose) {
    prior = frame.pose;
    fillCovariance(*prior);
  }
  if (!prior) {
    hold(id, "no position was recorded");
  } else if (const auto grey = capture::decodeImage(frame.image, capture::PixelFormat::Grey8); !grey) {
    hold(id, "the picture does not read");
  } else {
    waiting_.insert(id);
    auto poses =
        camera.adjuster->addFrame(id, {grey->bytes.data(), grey->width, grey->height, grey->stride}, *prior);
    if (poses)
      take(*poses, now_ns, out);
    else
      hold(id, "its size, time or pose cannot be used");
  }
  auto due = wait(now_ns);
  out.insert(out.end(), std::make_move_iterator(due.begin()), std::make_move_iterator(due.end()));
  return out;
}

std::vector<LiveFrame> LiveAdjuster::wait(std::int64_t now_ns) {
  std::vector<LiveFrame> out;
  const auto limit = static_cast<std::int64_t>(options_.max_wait_s * 1e9);
  for (const FrameId id : std::set<FrameId>(waiting_)) {
    const Known& known = known_.at(id);
    if (now_ns - known.arrived_ns < limit) continue;
    const auto pose = cameras_.at(known.camera_id)->adjuster->reportEarly(id);
    if (pose) take({*pose}, now_ns, out);
  }
  if (!moved_.empty() && (moved_.size() >= static_cast<std::size_t>(options_.adjuster.map.window_frames) ||
                          now_ns - moved_since_ns_ >= limit))
    handOnAgain(out);
  return out;
}

std::vector<LiveFrame> LiveAdjuster::land() {
  std::vector<LiveFrame> out;
  for (auto& [id, camera] : cameras_) {
    const bool whole = camera->frames <= static_cast<std::uint64_t>(options_.adjuster.map.retained_frames);
    take(whole ? camera->adjuster->adjustAll() : camera->adjuster->finish(), moved_since_ns_, out);
    const PoseMap::Summary summary = camera->adjuster->summary();
    if (!whole)
      notes_.push_back(
          fmt::format("camera {}: {} frames are more than are kept in memory; overfly adjust MAP "
                      "adjusts them all together",
                      id, camera->frames));
    if (options_.profiles.empty() || !worthKeeping(summary, camera->nominal, camera->map_options)) continue;
    const LensProfile profile{camera->adjuster->camera(), summary.sigmas.lens, summary.adjusted};
    if (const auto ok = writeLensProfile(options_.profiles / lensProfileName(id), profile); !ok)
      notes_.push_back(ok.error().message);
  }
  handOnAgain(out);
  return out;
}

void LiveAdjuster::take(const std::vector<AdjustedPose>& poses, std::int64_t now_ns,
                        std::vector<LiveFrame>& out) {
  // Hysteresis: what has moved by half of the limit goes along once something has moved by all of it.
  const double limit = options_.adjuster.map.revise_px;
  const bool any = !moved_.empty() || std::any_of(poses.begin(), poses.end(), [&](const AdjustedPose& pose) {
    return known_.at(pose.id).handed && pose.shift_px > limit;
  });
  for (const AdjustedPose& pose : poses) {
    const bool usable = pose.state == FrameState::Adjusted || pose.state == FrameState::PriorOnly;
    if (!usable) {
      if (!known_.at(pose.id).handed) hold(pose.id, pose.reason);
    } else if (!known_.at(pose.id).handed) {
      handOn(pose, out);
    } else if (any && (pose.shift_px > 0.5 * limit || moved_.contains(pose.id))) {
      if (moved_.empty()) moved_since_ns_ = now_ns;
      moved_.insert_or_assign(pose.id, pose);
    }
  }
}

void LiveAdjuster::handOn(const AdjustedPose& pose, std::vector<LiveFrame>& out) {
  waiting_.erase(pose.id);
  held_.erase(pose.id);
  known_.at(pose.id).handed = true;
  ++counts_.handed;
  counts_.adjusted += pose.state == FrameState::Adjusted ? 1 : 0;
  out.push_back({pose.id, pose.pose, pose.camera, pose.state == FrameState::Adjusted, false,
                 known_.at(pose.id).arrived_ns});
}

void LiveAdjuster::handOnAgain(std::vector<LiveFrame>& out) {
  if (moved_.empty()) return;
  for (const auto& [id, pose] : moved_)
    out.push_back({id, pose.pose, pose.camera, pose.state == FrameState::Adjusted, true, moved_since_ns_});
  counts_.revised += moved_.size();
  ++counts_.batches;
  moved_.clear();
}

std::vector<std::string> LiveAdjuster::takeNotes() { return std::exchange(notes_, {}); }

LiveAdjuster::Status LiveAdjuster::status() const {
  Status status = counts_;
  status.waiting = waiting_.size();
  for (const auto& [id, reason] : held_) ++status.held_back[reason];
  for (const auto& [id, camera] : cameras_)
    status.rms_px = std::max(status.rms_px, camera->adjuster->map().rmsPx());
  return status;
}

std::optional<PoseMap::Summary> LiveAdjuster::summaryOf(const std::string& camera_id) const {
  const auto camera = cameras_.find(camera_id);
  if (camera == cameras_.end()) return std::nullopt;
  return camera->second->adjuster->summary();
}

}  // namespace overfly::tiling::adjust
