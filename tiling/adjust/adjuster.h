#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "capture/camera_model.h"
#include "capture/geo/geodetic.h"
#include "capture/pose.h"
#include "config/error.h"
#include "tiling/adjust/features.h"
#include "tiling/adjust/pose_map.h"

namespace overfly::tiling::adjust {

struct AdjusterOptions {
  AdjustOptions map;
  FeatureOptions features;
  MatchOptions matching;
};

// What became of one frame. A frame is reported once when its window closes, and again (revision 1, 2, ...)
// when later evidence moves it by more than AdjustOptions::revise_px on the ground.
struct AdjustedPose {
  FrameId id = 0;
  FrameState state = FrameState::Waiting;
  std::string reason;   // why it is not adjusted; empty when it is
  capture::Pose pose;   // with covariance; adjusted, or the telemetry's where the state says so
  double shift_px = 0;  // on the ground, against what was reported before (first: the telemetry)
  int revision = 0;
  int observations = 0;         // image measurements that hold it
  double rms_px = 0;            // root mean square length of its re-projection residuals
  capture::CameraModel camera;  // the lens as it was calibrated together with this pose
};

// Pose adjustment of one camera's frames while they arrive: features, matches with the frames that overlap,
// windowed bundle adjustment. See PoseMap for the method and its bounds; docs/adjustment.md for figures.
// Thread rule: one thread, from construction to destruction. Deterministic for a given order of frames.
class Adjuster {
 public:
  explicit Adjuster(const capture::CameraModel& camera, const AdjusterOptions& options = {});
  ~Adjuster();
  Adjuster(const Adjuster&) = delete;
  Adjuster& operator=(const Adjuster&) = delete;

  // `image` must have the camera's size; it is only read during the call. `prior` is what the telemetry says
  // at the frame's time; its covariance is what the device claims of all its errors together. BadInput: an
  // image of another size, a pose that is not finite, a covariance that is not positive, a known id.
  [[nodiscard]] Result<std::vector<AdjustedPose>> addFrame(FrameId id, const GreyImage& image,
                                                           const capture::Pose& prior);
  // A frame before its window has closed, see PoseMap::reportEarly(); nullopt: unknown, or reported before.
  [[nodiscard]] std::optional<AdjustedPose> reportEarly(FrameId id);
  // Everything still open, when no frame will follow.
  [[nodiscard]] std::vector<AdjustedPose> finish();
  // One adjustment over all frames (after landing); every frame is reported. Needs retained_frames to be at
  // least the number of frames.
  [[nodiscard]] std::vector<AdjustedPose> adjustAll();

  struct ControlPoint {
    std::string name;
    geo::Geodetic place;
    Eigen::Vector3d sigma_m = Eigen::Vector3d::Constant(0.03);  // east, north, up
    bool check = false;
    std::vector<std::pair<FrameId, Eigen::Vector2d>> seen;  // pixels
  };
  // Before adjustAll(): points that are held to (or, as check points, compared with) their given places.
  void addControl(const ControlPoint& point);
  // After adjustAll(): adjusted minus given (ENU, metres); absent where fewer than two adjusted frames see
  // it.
  struct ControlResidual {
    std::string name;
    bool check = false;
    std::optional<Eigen::Vector3d> residual_m;
  };
  [[nodiscard]] std::vector<ControlResidual> controlResiduals() const;

  // The lens as calibrated so far, with its 1-sigma values (PoseMap::Summary::sigmas.lens).
  [[nodiscard]] capture::CameraModel camera() const { return map_.camera(); }
  [[nodiscard]] PoseMap::Summary summary() const { return map_.summary(); }
  // Local frame of the adjustment; absent before the first frame.
  [[nodiscard]] const std::optional<geo::LocalFrame>& localFrame() const { return local_; }
  [[nodiscard]] const PoseMap& map() const { return map_; }

 private:
  class ImageMatcher;
  [[nodiscard]] std::vector<AdjustedPose> inEcef(const std::vector<FrameUpdate>& updates) const;

  AdjusterOptions options_;
  capture::CameraModel camera_;
  PoseMap map_;
  std::unique_ptr<ImageMatcher> matcher_;
  std::optional<geo::LocalFrame> local_;
  std::map<FrameId, std::int64_t> times_;
};

}  // namespace overfly::tiling::adjust
