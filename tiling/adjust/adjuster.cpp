#include "tiling/adjust/adjuster.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>

namespace overfly::tiling::adjust {
namespace {

// Rotation from the ENU axes at a place into the adjustment's.
Eigen::Matrix3d localFromEnuAt(const geo::LocalFrame& local, const Eigen::Vector3d& ecef) {
  const geo::LocalFrame there(geo::geodeticFromEcef(ecef));
  return local.enuFromEcefRotation() * there.enuFromEcefRotation().transpose();
}

Eigen::Matrix<double, 6, 6> rotated(const Eigen::Matrix<double, 6, 6>& covariance, const Eigen::Matrix3d& r) {
  Eigen::Matrix<double, 6, 6> both = Eigen::Matrix<double, 6, 6>::Zero();
  both.topLeftCorner<3, 3>() = both.bottomRightCorner<3, 3>() = r;
  return both * covariance * both.transpose();
}

}  // namespace

class Adjuster::ImageMatcher : public Matcher {
 public:
  ImageMatcher(const capture::CameraModel& camera, const MatchOptions& options)
      : width_(camera.width), height_(camera.height), options_(options) {}
  void add(FrameId id, Features features) { features_[id] = std::move(features); }
  std::vector<Match> match(FrameId a, FrameId b, const MatchGuide* guide) override {
    return matchFeatures(features_.at(a), features_.at(b), guide, width_, height_, options_);
  }
  void forget(FrameId id) override { features_.erase(id); }

 private:
  int width_, height_;
  MatchOptions options_;
  std::map<FrameId, Features> features_;
};

Adjuster::Adjuster(const capture::CameraModel& camera, const AdjusterOptions& options)
    : options_(options),
      camera_(camera),
      map_(camera, options.map),
      matcher_(std::make_unique<ImageMatcher>(camera, options.matching)) {}

Adjuster::~Adjuster() = default;

Result<std::vector<AdjustedPose>> Adjuster::addFrame(FrameId id, const GreyImage& image,
                                                     const capture::Pose& prior) {
  if (image.data == nullptr || image.width != camera_.width || image.height != camera_.height)
    return fail(ErrorCode::BadInput, fmt::format("frame {} is {}x{} pixels, its camera {}x{}", id,
                                                 image.width, image.height, camera_.width, camera_.height));
  if (!prior.position_in_ecef.allFinite() || !prior.ecef_from_camera.coeffs().allFinite() ||
      prior.position_in_ecef.norm() < 6e6)
    return fail(ErrorCode::BadInput, fmt::format("frame {} has no usable pose to begin from", id));
  if (prior.covariance.llt().info() != Eigen::Success)
    return fail(ErrorCode::BadInput, fmt::format("the pose covariance of frame {} is not positive", id));
  if (times_.contains(id)) return fail(ErrorCode::BadInput, fmt::format("frame {} came twice", id));
  if (!local_) local_.emplace(geo::geodeticFromEcef(prior.position_in_ecef));
  times_[id] = prior.time_ns;

  PriorPose p;
  p.time_ns = prior.time_ns;
  p.position = local_->enuFromEcef(prior.position_in_ecef);
  p.enu_from_camera =
      (Eigen::Quaterniond(local_->enuFromEcefRotation()) * prior.ecef_from_camera).normalized();
  p.covariance = rotated(prior.covariance, localFromEnuAt(*local_, prior.position_in_ecef));
  Features features = findFeatures(image, options_.features);
  auto pixels = features.pixels;
  matcher_->add(id, std::move(features));
  auto updates = inEcef(map_.add(id, p, std::move(pixels), *matcher_));
  while (times_.size() > 4 * static_cast<std::size_t>(options_.map.retained_frames))
    times_.erase(times_.begin());
  return updates;
}

std::optional<AdjustedPose> Adjuster::reportEarly(FrameId id) {
  const auto update = map_.reportEarly(id);
  if (!update) return std::nullopt;
  return inEcef({*update}).front();
}

std::vector<AdjustedPose> Adjuster::finish() { return inEcef(map_.finish()); }

std::vector<AdjustedPose> Adjuster::adjustAll() { return inEcef(map_.adjustAll(*matcher_)); }

std::vector<AdjustedPose> Adjuster::inEcef(const std::vector<FrameUpdate>& updates) const {
  std::vector<AdjustedPose> out;
  for (const auto& u : updates) {
    AdjustedPose a;
    a.id = u.id;
    a.state = u.state;
    a.reason = u.reason;
    a.shift_px = u.shift_px;
    a.revision = u.revision;
    a.observations = u.observations;
    a.rms_px = u.rms_px;
    a.camera = u.camera;
    const auto time = times_.find(u.id);
    if (time != times_.end()) a.pose.time_ns = time->second;
    a.pose.position_in_ecef = local_->ecefFromEnu(u.position);
    a.pose.ecef_from_camera =
        (Eigen::Quaterniond(local_->enuFromEcefRotation().transpose()) * u.enu_from_camera).normalized();
    a.pose.covariance = rotated(u.covariance, localFromEnuAt(*local_, a.pose.position_in_ecef).transpose());
    out.push_back(std::move(a));
  }
  return out;
}

void Adjuster::addControl(const ControlPoint& point) {
  if (!local_) return;
  PoseMap::Control c;
  c.name = point.name;
  c.position = local_->enuFromEcef(geo::ecefFromGeodetic(point.place));
  c.sigma_m = point.sigma_m;
  c.check = point.check;
  c.seen = point.seen;
  map_.control().push_back(std::move(c));
}

std::vector<Adjuster::ControlResidual> Adjuster::controlResiduals() const {
  std::vector<ControlResidual> out;
  for (const auto& c : map_.control()) out.push_back({c.name, c.check, c.residual_m});
  return out;
}

}  // namespace overfly::tiling::adjust
