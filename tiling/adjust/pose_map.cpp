#include "tiling/adjust/pose_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

// The flow of frames: start, location, closing, forgetting.
namespace overfly::tiling::adjust {
namespace {

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

constexpr int kStartMatches = 40;        // verified matches that a first pair needs
constexpr double kStartParallax = 0.05;  // its median parallax, radians
constexpr std::size_t kStartFrames = 6;  // waiting frames that a new one is paired with
constexpr double kStartBaseline = 0.3;   // metres between its telemetry positions: gives the scale
constexpr double kGuidedShare = 0.2;     // of the image width: predictions worse than this guide nothing
constexpr double kSearchShare = 0.02;    // of it: how far relief moves a place predicted on flat ground

}  // namespace

PoseMap::PoseMap(const capture::CameraModel& camera, const AdjustOptions& options) : options_(options) {
  lens_.model = camera;
  shared_.lens = prior_.lens = lens_.parameters();
  const double side = std::max(camera.width, camera.height);
  prior_sigmas_.lens[0] = options.sigma_focal * camera.fx;
  prior_sigmas_.lens[1] = prior_sigmas_.lens[2] = options.sigma_principal * side;
  for (int i = 0; i < 5; ++i)
    prior_sigmas_.lens[3 + i] = options.sigma_distortion[static_cast<std::size_t>(i)];
  if (options.sigma_lens) prior_sigmas_.lens = *options.sigma_lens;
  prior_sigmas_.boresight.setConstant(options.sigma_boresight);
  prior_sigmas_.lever_m.setConstant(options.sigma_lever_m);
  prior_sigmas_.delay_s = options.sigma_delay_s;
  sigmas_ = prior_sigmas_;
  delay_sigma_ = prior_sigmas_.delay_s;
}

std::vector<FrameUpdate> PoseMap::add(FrameId id, const PriorPose& prior,
                                      std::vector<Eigen::Vector2d> keypoints, Matcher& matcher) {
  if (frames_.contains(id)) return {};
  if (arrivals_ == 0) prior_sigmas_.offset_m = prior.covariance.diagonal().head<3>().cwiseSqrt();
  Frame& frame = frames_[id];
  frame.prior = prior;
  frame.tracks.assign(keypoints.size(), -1);
  frame.keypoints = std::move(keypoints);
  frame.order = arrivals_++;
  open_.push_back(id);
  arrived_.push_back(id);

  bool placed = located_count_ > 0 && locate(id, matcher);
  if (placed)
    extend(id, matcher);
  else if (frame.reason.rfind("the same picture", 0) != 0)
    placed = bootstrap(id, matcher);
  if (placed) {
    retryWaiting(matcher);
    int in_component = 0;
    for (const auto& [other, f] : frames_)
      in_component += f.located && f.component == frame.component ? 1 : 0;
    if (in_component <= 12) alignToTelemetry(frame.component);
    if (located_count_ >= next_regional_) {
      auto region = locatedInOrder();
      const auto most = static_cast<std::size_t>(options_.regional_frames);
      if (region.size() > most)
        region.erase(region.begin(), region.end() - static_cast<std::ptrdiff_t>(most));
      adjustRegion(region, options_.regional_observations, 2, false);
      next_regional_ = located_count_ + std::clamp(located_count_ / 2, 4, options_.regional_every);
    } else {
      adjustWindow();
    }
  }
  auto updates = close(false);
  forgetOld(matcher);
  return updates;
}

std::vector<FrameUpdate> PoseMap::finish() { return close(true); }

bool PoseMap::isSamePicture(FrameId a, FrameId b, const std::vector<Match>& matches) const {
  const Frame &fa = frames_.at(a), &fb = frames_.at(b);
  if (matches.size() < std::max<std::size_t>(20, fa.keypoints.size() / 3)) return false;
  std::vector<double> moved;
  for (const auto& m : matches)
    moved.push_back(
        (fa.keypoints[static_cast<std::size_t>(m.a)] - fb.keypoints[static_cast<std::size_t>(m.b)]).norm());
  return median(std::move(moved)) < 0.01;
}

// Two frames that see the same ground from places far enough apart become the start of the map, or of a
// part that is not yet connected with it. The scale comes from the telemetry.
bool PoseMap::bootstrap(FrameId id, Matcher& matcher) {
  Frame& frame = frames_.at(id);
  std::size_t tried = 0;
  int most_matches = 0;
  double most_parallax = 0;
  for (auto it = arrived_.rbegin(); it != arrived_.rend() && tried < kStartFrames; ++it) {
    Frame& other = frames_.at(*it);
    if (*it == id || other.located || frame.order - other.order > 2 * static_cast<int>(kStartFrames))
      continue;
    ++tried;
    const auto matches = freeMatches(*it, id, matcher);
    if (isSamePicture(*it, id, matches)) {
      frame.reason = fmt::format("the same picture as frame {}", *it);
      return false;
    }
    most_matches = std::max(most_matches, static_cast<int>(matches.size()));
    const double baseline = (frame.prior.position - other.prior.position).norm();
    if (static_cast<int>(matches.size()) < kStartMatches || baseline < kStartBaseline) continue;
    std::vector<Eigen::Vector2d> in_a, in_b;
    for (const auto& m : matches) {
      in_a.push_back(normalise(other.keypoints[static_cast<std::size_t>(m.a)]));
      in_b.push_back(normalise(frame.keypoints[static_cast<std::size_t>(m.b)]));
    }
    RelativePoseHints hints;
    hints.tolerance = 1.5 / shared_.lens[0];
    hints.up_in_a = other.prior.enu_from_camera.conjugate() * Eigen::Vector3d::UnitZ();
    hints.up_in_b = frame.prior.enu_from_camera.conjugate() * Eigen::Vector3d::UnitZ();
    const auto relative = relativePose(in_a, in_b, hints);
    if (relative) most_parallax = std::max(most_parallax, relative->median_parallax);
    if (!relative || relative->inliers < kStartMatches || relative->median_parallax < kStartParallax)
      continue;
    // Heading and scale of the pair from the telemetry; alignToTelemetry() weighs them against attitude.
    other.view = {other.prior.position, other.prior.enu_from_camera};
    frame.view.position = other.view.position + other.view.world_from_camera * relative->b_in_a * baseline;
    frame.view.world_from_camera = other.view.world_from_camera * relative->a_from_b;
    other.located = frame.located = true;
    other.component = frame.component = ++components_;
    join(*it, id, matches);
    triangulateTracks(id);
    int known = 0;
    for (const int t : frame.tracks) known += t >= 0 && tracks_[static_cast<std::size_t>(t)].known ? 1 : 0;
    if (known < kStartMatches / 2) {
      for (const int t : std::vector<int>(frame.tracks))
        if (t >= 0) dropTrack(t);
      other.located = frame.located = false;
      continue;
    }
    located_count_ += 2;
    located_at_[other.prior.time_ns] = *it;
    located_at_[frame.prior.time_ns] = id;
    if (other.closed) to_revise_.insert(*it);
    frame.reason.clear();
    other.reason.clear();
    alignToTelemetry(frame.component);
    return true;
  }
  if (frame.reason.empty()) {
    if (tried == 0)
      frame.reason = "the first frame waits for a second one";
    else if (most_matches < kStartMatches)
      frame.reason = fmt::format("no overlap: at most {} matches with an earlier frame", most_matches);
    else
      frame.reason =
          fmt::format("no parallax: seen from the same place ({:.1f} degrees)", most_parallax * 57.29578);
  }
  return false;
}

bool PoseMap::locate(FrameId id, Matcher& matcher) {
  Frame& frame = frames_.at(id);
  ++frame.attempts;
  const View guess = predicted(id);
  const double radius = predictionRadius(id);
  const bool guided = radius < kGuidedShare * lens_.model.width;
  // Nearest in time, then where the prediction says it overlaps.
  std::vector<std::pair<std::int64_t, FrameId>> by_time;
  for (const auto& [other, f] : frames_)
    if (f.located) by_time.emplace_back(std::abs(f.prior.time_ns - frame.prior.time_ns), other);
  std::sort(by_time.begin(), by_time.end());
  std::vector<FrameId> candidates;
  for (std::size_t i = 0; i < std::min<std::size_t>(2, by_time.size()); ++i)
    candidates.push_back(by_time[i].second);
  for (const FrameId other : overlapping(id, guess, 2, guided ? 1.0 : 1.5))
    if (std::find(candidates.begin(), candidates.end(), other) == candidates.end())
      candidates.push_back(other);

  std::vector<std::pair<FrameId, std::vector<Match>>> links;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> seen;
  std::vector<int> keypoints;
  std::set<int> used;
  std::map<int, int> votes;  // component -> correspondences
  std::size_t most_matches = 0;
  for (const FrameId other : candidates) {
    if (frame.linked.contains(other)) continue;
    std::vector<Match> matches;
    if (guided) {
      const auto raw = guidedMatches(id, guess, other, radius, matcher);
      std::vector<Eigen::Vector2d> in_a, in_b;
      for (const auto& m : raw) {
        in_a.push_back(normalise(frame.keypoints[static_cast<std::size_t>(m.a)]));
        in_b.push_back(normalise(frames_.at(other).keypoints[static_cast<std::size_t>(m.b)]));
      }
      for (const int i : verifiedMatches(in_a, in_b, 1.5 / shared_.lens[0], 2 * options_.least_points))
        matches.push_back(raw[static_cast<std::size_t>(i)]);
    }
    if (matches.empty()) matches = freeMatches(id, other, matcher);
    most_matches = std::max(most_matches, matches.size());
    if (isSamePicture(id, other, matches)) {
      frame.reason = fmt::format("the same picture as frame {}", other);
      return false;
    }
    for (const auto& m : matches) {
      const int t = frames_.at(other).tracks[static_cast<std::size_t>(m.b)];
      if (t < 0 || !tracks_[static_cast<std::size_t>(t)].known || used.contains(m.a)) continue;
      used.insert(m.a);
      points.push_back(tracks_[static_cast<std::size_t>(t)].point);
      seen.push_back(normalise(frame.keypoints[static_cast<std::size_t>(m.a)]));
      keypoints.push_back(m.a);
      ++votes[frames_.at(other).component];
    }
    links.emplace_back(other, std::move(matches));
  }
  if (static_cast<int>(points.size()) < options_.least_points) {
    frame.reason = most_matches < static_cast<std::size_t>(options_.least_points)
                       ? fmt::format("no overlap: at most {} matches with an adjusted frame", most_matches)
                       : fmt::format("too few known points: {} matches", points.size());
    return false;
  }
  const auto found = resect(points, seen, options_.gate_px / shared_.lens[0], options_.least_points);
  if (!found || static_cast<double>(found->inliers.size()) < 0.25 * static_cast<double>(points.size())) {
    frame.reason = fmt::format("no agreement: its {} matches do not fit one pose", points.size());
    return false;
  }
  std::vector<double> off;
  for (const int i : found->inliers) {
    const auto at = projectWith(
        lens_, shared_.lens,
        guess.world_from_camera.conjugate() * (points[static_cast<std::size_t>(i)] - guess.position));
    if (at)
      off.push_back(
          (*at - frame.keypoints[static_cast<std::size_t>(keypoints[static_cast<std::size_t>(i)])]).norm());
  }
  innovations_px_.push_back(off.empty() ? lens_.model.width : median(std::move(off)));
  if (innovations_px_.size() > 6) innovations_px_.pop_front();
  frame.view = found->view;
  frame.located = true;
  frame.reason.clear();
  frame.component = std::max_element(votes.begin(), votes.end(), [](const auto& a, const auto& b) {
                      return a.second < b.second;
                    })->first;
  ++located_count_;
  located_at_[frame.prior.time_ns] = id;
  for (const auto& [other, matches] : links)
    if (!matches.empty()) join(id, other, matches);
  return true;
}

// Links a located frame with the others that it overlaps, and makes points of what has parallax now.
void PoseMap::extend(FrameId id, Matcher& matcher) {
  Frame& frame = frames_.at(id);
  triangulateTracks(id);
  for (const FrameId other :
       overlapping(id, frame.view, static_cast<std::size_t>(options_.link_frames), 1.0)) {
    if (frame.linked.contains(other)) continue;
    const Frame& there = frames_.at(other);
    std::vector<Match> kept;
    if (there.component == frame.component) {
      for (const auto& m : guidedMatches(id, frame.view, other, kSearchShare * lens_.model.width, matcher)) {
        const std::array<View, 2> views{frame.view, there.view};
        const std::array<Eigen::Vector2d, 2> seen{normalise(frame.keypoints[static_cast<std::size_t>(m.a)]),
                                                  normalise(there.keypoints[static_cast<std::size_t>(m.b)])};
        const auto x = triangulate(views, seen);
        if (x && residualPx(frame, m.a, *x) < options_.gate_px &&
            residualPx(there, m.b, *x) < options_.gate_px)
          kept.push_back(m);
      }
    } else {
      kept = freeMatches(id, other, matcher);
    }
    if (static_cast<int>(kept.size()) >= options_.least_points) join(id, other, kept);
  }
  triangulateTracks(id);
}

void PoseMap::retryWaiting(Matcher& matcher) {
  for (const FrameId id : std::vector<FrameId>(open_.begin(), open_.end())) {
    Frame& frame = frames_.at(id);
    if (frame.located || frame.attempts >= 4 || frame.reason.rfind("the same picture", 0) == 0) continue;
    if (locate(id, matcher)) extend(id, matcher);
  }
}

FrameUpdate PoseMap::describe(FrameId id) const {
  const Frame& frame = frames_.at(id);
  FrameUpdate update;
  update.id = id;
  update.revision = frame.revision;
  update.camera = camera();
  View view = frame.view;
  if (frame.located) {
    update.state = FrameState::Adjusted;
    update.covariance = frame.covariance;
    double sum2 = 0;
    for (std::size_t k = 0; k < frame.tracks.size(); ++k) {
      const int t = frame.tracks[k];
      if (t < 0 || !tracks_[static_cast<std::size_t>(t)].known) continue;
      const double r = residualPx(frame, static_cast<int>(k), tracks_[static_cast<std::size_t>(t)].point);
      sum2 += r * r;
      ++update.observations;
    }
    if (update.observations > 0) update.rms_px = std::sqrt(sum2 / update.observations);
  } else {
    view = predicted(id);
    BundleFrame prior;
    fillPrior(frame, prior);
    update.covariance.topLeftCorner<3, 3>() = prior.prior_position_covariance;
    update.covariance.bottomRightCorner<3, 3>() = prior.prior_attitude_covariance;
    const auto sigma = update.covariance.diagonal().cwiseSqrt();
    const double height = std::max(1.0, view.position.z() - groundHeight(view.position));
    const double off_px =
        shared_.lens[0] * (sigma.head<3>().maxCoeff() / height + sigma.tail<3>().maxCoeff());
    update.state = off_px < 2 ? FrameState::PriorOnly : FrameState::HeldBack;
    update.reason = frame.reason.empty() ? "no neighbour was adjusted" : frame.reason;
  }
  update.position = view.position;
  update.enu_from_camera = view.world_from_camera;
  const Frame::Reported before = frame.reported.value_or(
      Frame::Reported{{frame.prior.position, frame.prior.enu_from_camera}, prior_.lens, false});
  update.shift_px = shiftPx(before, view);
  return update;
}

FrameUpdate PoseMap::report(FrameId id, bool closed) {
  FrameUpdate update = describe(id);
  Frame& frame = frames_.at(id);
  ++frame.revision;
  frame.reported = {{update.position, update.enu_from_camera}, shared_.lens, frame.located};
  frame.closed = closed;
  return update;
}

std::optional<FrameUpdate> PoseMap::reportEarly(FrameId id) {
  const auto it = frames_.find(id);
  if (it == frames_.end() || it->second.reported) return std::nullopt;
  FrameUpdate update = describe(id);
  if (update.state == FrameState::HeldBack) return update;
  return report(id, false);
}

std::vector<FrameUpdate> PoseMap::close(bool all) {
  std::vector<FrameUpdate> updates;
  while (!open_.empty() && (all || open_.size() > static_cast<std::size_t>(options_.window_frames))) {
    const FrameId id = open_.front();
    open_.pop_front();
    Frame& frame = frames_.at(id);
    const bool told = frame.reported && frame.reported->located == frame.located;
    if (told &&
        shiftPx(*frame.reported, frame.located ? frame.view : frame.reported->view) <= options_.revise_px)
      frame.closed = true;
    else
      updates.push_back(report(id));
  }
  std::vector<FrameId> moved;
  bool any = false;
  for (const FrameId id : to_revise_) {
    const auto it = frames_.find(id);
    if (it == frames_.end() || !it->second.closed || !it->second.reported || !it->second.located) continue;
    const double shift = shiftPx(*it->second.reported, it->second.view);
    const bool placed = !it->second.reported->located;  // it was held back, or used with its telemetry
    any = any || placed || shift > options_.revise_px;
    if (placed || shift > 0.5 * options_.revise_px) moved.push_back(id);
  }
  if (any)
    for (const FrameId id : moved) updates.push_back(report(id));
  to_revise_.clear();
  return updates;
}

void PoseMap::forgetOld(Matcher& matcher) {
  while (arrived_.size() > static_cast<std::size_t>(options_.retained_frames)) {
    const FrameId id = arrived_.front();
    Frame& frame = frames_.at(id);
    if (!frame.closed) break;
    for (std::size_t k = 0; k < frame.tracks.size(); ++k) {
      const int t = frame.tracks[k];
      if (t < 0) continue;
      auto& seen = tracks_[static_cast<std::size_t>(t)].seen;
      for (std::size_t i = 0; i < seen.size(); ++i)
        if (seen[i].frame == id) {
          dropSighting(t, i);
          break;
        }
      if (seen.size() < 2) dropTrack(t);
    }
    for (const FrameId other : frame.linked) {
      const auto it = frames_.find(other);
      if (it != frames_.end()) it->second.linked.erase(id);
    }
    located_at_.erase(frame.prior.time_ns);
    frames_.erase(id);
    arrived_.pop_front();
    matcher.forget(id);
  }
}

std::vector<FrameId> PoseMap::locatedInOrder() const {
  std::vector<FrameId> out;
  for (const FrameId id : arrived_)
    if (frames_.at(id).located) out.push_back(id);
  return out;
}

double PoseMap::shiftPx(const Frame::Reported& from, const View& to) const {
  const Eigen::Vector3d& centre = from.view.position;
  const double ground = groundHeight(centre), w = lens_.model.width, h = lens_.model.height;
  double most = 0;
  for (const Eigen::Vector2d& px : {Eigen::Vector2d(w / 2, h / 2), Eigen::Vector2d(0, 0),
                                    Eigen::Vector2d(w, 0), Eigen::Vector2d(w, h), Eigen::Vector2d(0, h)}) {
    const Eigen::Vector3d ray = from.view.world_from_camera * normalise(px, from.lens).homogeneous();
    if (ray.z() > -0.05 * ray.norm()) continue;
    const Eigen::Vector3d x = centre + ray * ((ground - centre.z()) / ray.z());
    const auto there = projectWith(lens_, shared_.lens, to.world_from_camera.conjugate() * (x - to.position));
    if (there) most = std::max(most, (*there - px).norm());
  }
  return most;
}

PoseMap::Summary PoseMap::summary() const {
  Summary s;
  s.frames = arrivals_;
  std::vector<double> heights;
  s.adjusted = located_count_;
  for (const auto& track : tracks_) {
    if (!track.known) continue;
    ++s.points;
    s.observations += static_cast<int>(track.seen.size());
    heights.push_back(track.point.z());
  }
  s.rms_px = rms_px_;
  s.shared = shared_;
  s.sigmas = sigmas_;
  if (!frames_.empty()) {
    const auto sigma = frames_.begin()->second.prior.covariance.diagonal().cwiseSqrt();
    s.noise_horizontal_m = sigma[0] * noise_.horizontal;
    s.noise_vertical_m = sigma[2] * noise_.vertical;
    s.noise_tilt = sigma[3] * noise_.tilt;
    s.noise_heading = sigma[5] * noise_.heading;
  }
  s.ground_height_m = median(std::move(heights));
  s.dome = dome_;
  return s;
}

std::vector<Eigen::Vector3d> PoseMap::points(int least_views) const {
  std::vector<Eigen::Vector3d> out;
  for (const auto& track : tracks_)
    if (track.known && static_cast<int>(track.seen.size()) >= least_views) out.push_back(track.point);
  return out;
}

}  // namespace overfly::tiling::adjust
