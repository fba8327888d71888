#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>

#include "tiling/adjust/pose_map.h"

// Least squares over parts of the map.
namespace overfly::tiling::adjust {
namespace {

constexpr double kLeastHoldPosition = 0.02;    // metres: what an older frame may move by at least
constexpr double kLeastHoldAttitude = 0.0003;  // radians
constexpr double kControlSigmaPx = 1.0;        // how well a person marks a control point
constexpr double kCrossRadiusShare = 0.03;     // of the image width: search between legs that were not linked

}  // namespace

std::vector<FrameId> PoseMap::neighboursOf(const std::vector<FrameId>& frames, std::size_t most) const {
  const std::set<FrameId> inside(frames.begin(), frames.end());
  std::map<FrameId, int> shared;
  for (const FrameId id : frames)
    for (const int t : frames_.at(id).tracks)
      if (t >= 0 && tracks_[static_cast<std::size_t>(t)].known)
        for (const auto& s : tracks_[static_cast<std::size_t>(t)].seen)
          if (!inside.contains(s.frame) && frames_.at(s.frame).located) ++shared[s.frame];
  std::vector<std::pair<int, FrameId>> ranked;
  for (const auto& [id, n] : shared)
    if (n >= 10) ranked.emplace_back(-n, id);
  std::sort(ranked.begin(), ranked.end());
  std::vector<FrameId> out;
  for (std::size_t i = 0; i < std::min(most, ranked.size()); ++i) out.push_back(ranked[i].second);
  return out;
}

// What is uncertain of a frame against the telemetry's mean. Neighbouring frames have nearly all of it in
// common, so each of n counts for an n-th.
BundleFrame::Hold PoseMap::holdOf(const Frame& frame, std::size_t held_frames) const {
  BundleFrame::Hold hold;
  const auto n = static_cast<double>(held_frames);
  const Eigen::Matrix3d position = frame.covariance.topLeftCorner<3, 3>() -
                                   Eigen::Matrix3d(prior_sigmas_.offset_m.cwiseAbs2().asDiagonal());
  hold.position_covariance =
      n * Eigen::Matrix3d(position.diagonal().cwiseMax(kLeastHoldPosition * kLeastHoldPosition).asDiagonal());
  hold.attitude_covariance = n * Eigen::Matrix3d(frame.covariance.diagonal()
                                                     .tail<3>()
                                                     .cwiseMax(kLeastHoldAttitude * kLeastHoldAttitude)
                                                     .asDiagonal());
  return hold;
}

// Measurements are thinned to about `observations` per frame, spread over the picture, long tracks first.
Bundle PoseMap::makeBundle(const std::vector<FrameId>& free, const std::vector<FrameId>& others, bool soft,
                           int observations, std::vector<int>& tracks) const {
  Bundle bundle;
  bundle.lens = lens_;
  bundle.shared = shared_;
  bundle.prior = prior_;
  bundle.prior_sigmas = prior_sigmas_;
  if (prior_sigmas_.delay_s > 0) bundle.prior_sigmas.delay_s = delay_sigma_;
  // A common offset of the telemetry shows only against control points. Left free, it would let the map drift
  // away from the telemetry; its uncertainty is added to the poses' instead.
  const bool controlled =
      std::any_of(control_.begin(), control_.end(), [](const auto& c) { return !c.check; });
  if (!controlled) bundle.prior_sigmas.offset_m.setZero();
  std::map<FrameId, int> index;
  for (const auto* list : {&free, &others})
    for (const FrameId id : *list) {
      const Frame& frame = frames_.at(id);
      index[id] = static_cast<int>(bundle.frames.size());
      BundleFrame& f = bundle.frames.emplace_back();
      f.position = frame.view.position;
      f.enu_from_camera = frame.view.world_from_camera;
      f.fixed = list == &others && !soft;
      if (list == &free)
        fillPrior(frame, f);
      else if (soft)
        f.hold = holdOf(frame, others.size());
    }
  constexpr int kColumns = 8, kRows = 6;
  const int room = std::max(1, (observations + kColumns * kRows - 1) / (kColumns * kRows));
  std::set<int> seen_tracks;
  for (const FrameId id : free)
    for (const int t : frames_.at(id).tracks)
      if (t >= 0 && tracks_[static_cast<std::size_t>(t)].known) seen_tracks.insert(t);
  std::vector<std::pair<int, int>> ranked;  // minus length inside, track
  for (const int t : seen_tracks) {
    int inside = 0;
    for (const auto& s : tracks_[static_cast<std::size_t>(t)].seen) inside += index.contains(s.frame) ? 1 : 0;
    if (inside >= 2) ranked.emplace_back(-inside, t);
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<std::array<int, kColumns * kRows>> filled(bundle.frames.size());
  for (auto& f : filled) f.fill(0);
  tracks.clear();
  for (const auto& [length, t] : ranked) {
    const Track& track = tracks_[static_cast<std::size_t>(t)];
    bool wanted = false;
    std::vector<std::pair<int, int>> cells;  // frame index, cell
    for (const auto& s : track.seen) {
      const auto it = index.find(s.frame);
      if (it == index.end()) continue;
      const auto& px = frames_.at(s.frame).keypoints[static_cast<std::size_t>(s.keypoint)];
      const int c = std::clamp(static_cast<int>(px.x() / lens_.model.width * kColumns), 0, kColumns - 1);
      const int r = std::clamp(static_cast<int>(px.y() / lens_.model.height * kRows), 0, kRows - 1);
      cells.emplace_back(it->second, r * kColumns + c);
      wanted |=
          !bundle.frames[static_cast<std::size_t>(it->second)].fixed &&
          filled[static_cast<std::size_t>(it->second)][static_cast<std::size_t>(r * kColumns + c)] < room;
    }
    if (!wanted) continue;
    for (const auto& [f, c] : cells) ++filled[static_cast<std::size_t>(f)][static_cast<std::size_t>(c)];
    const int point = static_cast<int>(bundle.points.size());
    bundle.points.push_back(track.point);
    tracks.push_back(t);
    for (const auto& s : track.seen) {
      const auto it = index.find(s.frame);
      if (it == index.end()) continue;
      bundle.observations.push_back(
          {it->second, point, frames_.at(s.frame).keypoints[static_cast<std::size_t>(s.keypoint)], 0});
    }
  }
  return bundle;
}

void PoseMap::takeBack(const Bundle& bundle, const std::vector<FrameId>& frames,
                       const std::vector<int>& tracks) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    Frame& frame = frames_.at(frames[i]);
    frame.view = {bundle.frames[i].position, bundle.frames[i].enu_from_camera};
    if (frame.closed) to_revise_.insert(frames[i]);
  }
  for (std::size_t i = 0; i < tracks.size(); ++i)
    tracks_[static_cast<std::size_t>(tracks[i])].point = bundle.points[i];
  shared_ = bundle.shared;
}

// Points anew from the poses as they are now (thinned-out ones took no part in the adjustment).
void PoseMap::refreshPoints(const std::vector<FrameId>& frames) {
  std::set<int> touched;
  for (const FrameId id : frames)
    for (const int t : frames_.at(id).tracks)
      if (t >= 0 && tracks_[static_cast<std::size_t>(t)].seen.size() > 1) touched.insert(t);
  for (const int t : touched) makePoint(t);
}

int PoseMap::prune(const std::vector<FrameId>& frames, double limit_px) {
  int dropped = 0;
  for (const FrameId id : frames) {
    Frame& frame = frames_.at(id);
    for (std::size_t k = 0; k < frame.tracks.size(); ++k) {
      const int t = frame.tracks[k];
      if (t < 0 || !tracks_[static_cast<std::size_t>(t)].known) continue;
      Track& track = tracks_[static_cast<std::size_t>(t)];
      if (residualPx(frame, static_cast<int>(k), track.point) <= limit_px) continue;
      for (std::size_t i = 0; i < track.seen.size(); ++i)
        if (track.seen[i].frame == id) {
          dropSighting(t, i);
          break;
        }
      if (track.seen.size() < 2) dropTrack(t);
      ++dropped;
    }
  }
  return dropped;
}

void PoseMap::adjustWindow() {
  auto free = locatedInOrder();
  const auto most = static_cast<std::size_t>(options_.window_frames);
  if (free.size() > most + 2) free.erase(free.begin(), free.end() - static_cast<std::ptrdiff_t>(most));
  const auto fixed = neighboursOf(free, static_cast<std::size_t>(options_.fixed_neighbours));
  std::vector<int> tracks;
  Bundle bundle = makeBundle(free, fixed, false, options_.window_observations, tracks);
  SolveOptions solving;
  solving.sigma_px = options_.sigma_px;
  solving.threads = options_.threads;
  solving.max_iterations = 10;
  solving.free_shared = false;
  solving.covariance = true;
  const SolveReport solved = solve(bundle, solving);
  if (!solved.usable) return;
  takeBack(bundle, free, tracks);
  // The window's covariance is relative to the frames that hold it: theirs is added.
  Eigen::Matrix<double, 6, 6> held = Eigen::Matrix<double, 6, 6>::Zero();
  for (const FrameId id : fixed) held += frames_.at(id).covariance / static_cast<double>(fixed.size());
  if (fixed.empty())  // the offset of the telemetry is not in this adjustment
    held.diagonal().head<3>() = prior_sigmas_.offset_m.cwiseAbs2();
  for (std::size_t i = 0; i < free.size(); ++i)
    frames_.at(free[i]).covariance = solved.frame_covariances[i] + held;
  refreshPoints(free);
  prune(free, options_.gate_px);
}

void PoseMap::adjustRegion(const std::vector<FrameId>& free, int observations, int rounds, bool all) {
  std::vector<FrameId> held;
  if (!all) held = neighboursOf(free, static_cast<std::size_t>(2 * options_.fixed_neighbours));
  std::vector<FrameId> moved = free;
  moved.insert(moved.end(), held.begin(), held.end());
  searchDelay(free);
  for (int round = 0; round < rounds; ++round) {
    std::vector<int> tracks;
    Bundle bundle = makeBundle(free, held, !all, observations, tracks);
    if (all) addControl(free, bundle);
    SolveOptions solving;
    solving.sigma_px = options_.sigma_px;
    solving.threads = options_.threads;
    solving.stop = options_.stop;
    solving.max_iterations = all ? 40 : 15;
    solving.covariance = round + 1 == rounds;
    solving.dome = all;
    const SolveReport solved = solve(bundle, solving);
    if (!solved.usable) return;
    takeBack(bundle, moved, tracks);
    rms_px_ = solved.rms_px;
    if (solving.covariance) {
      sigmas_ = solved.shared_sigmas;
      dome_ = solved.dome;
      const bool offset_free = bundle.prior_sigmas.offset_m.maxCoeff() > 0;
      if (!offset_free) sigmas_.offset_m = prior_sigmas_.offset_m;
      for (std::size_t i = 0; i < free.size(); ++i) {
        frames_.at(free[i]).covariance = solved.frame_covariances[i];
        if (!offset_free)
          frames_.at(free[i]).covariance.diagonal().head<3>() += prior_sigmas_.offset_m.cwiseAbs2();
      }
    }
    refreshPoints(moved);
    prune(free, all && round > 0 ? std::max(4 * options_.sigma_px * solved.sigma0, 1.5) : options_.gate_px);
    estimateNoise(free);
  }
}

// x -> scale * turn * (x - from) + to, for frames and the points that they see.
void PoseMap::move(const std::vector<FrameId>& members, double scale, const Eigen::Quaterniond& turn,
                   const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const auto moved = [&](const Eigen::Vector3d& x) -> Eigen::Vector3d {
    return scale * (turn * (x - from)) + to;
  };
  std::set<int> touched;
  for (const FrameId id : members) {
    Frame& frame = frames_.at(id);
    frame.view = {moved(frame.view.position), (turn * frame.view.world_from_camera).normalized()};
    if (frame.closed) to_revise_.insert(id);
    touched.insert(frame.tracks.begin(), frame.tracks.end());
  }
  for (const int t : touched)
    if (t >= 0 && tracks_[static_cast<std::size_t>(t)].known)
      tracks_[static_cast<std::size_t>(t)].point = moved(tracks_[static_cast<std::size_t>(t)].point);
}

std::optional<Eigen::Vector3d> PoseMap::controlPlace(const Control& control) const {
  std::vector<View> views;
  std::vector<Eigen::Vector2d> seen;
  for (const auto& [id, pixel] : control.seen) {
    const auto it = frames_.find(id);
    if (it == frames_.end() || !it->second.located) continue;
    views.push_back(it->second.view);
    seen.push_back(normalise(pixel));
  }
  if (views.size() < 2) return std::nullopt;
  return triangulate(views, seen);
}

// The whole map onto the control points: three or more give a similarity, fewer a shift. The telemetry's
// common offset takes up what that moves, so that telemetry and control do not pull against each other.
void PoseMap::alignToControl(const std::vector<FrameId>& frames) {
  std::vector<Eigen::Vector3d> from, to;
  for (const auto& control : control_) {
    const auto place = control.check ? std::nullopt : controlPlace(control);
    if (!place) continue;
    from.push_back(*place);
    to.push_back(control.position);
  }
  if (from.empty()) return;
  Eigen::Matrix3Xd a(3, from.size()), b(3, to.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    a.col(static_cast<Eigen::Index>(i)) = from[i];
    b.col(static_cast<Eigen::Index>(i)) = to[i];
  }
  const Eigen::Vector3d centre_a = a.rowwise().mean(), centre_b = b.rowwise().mean();
  double scale = 1;
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  // Points on one line leave a turn about it open.
  const Eigen::JacobiSVD<Eigen::Matrix3Xd> spread(b.colwise() - centre_b);
  if (from.size() >= 3 && spread.singularValues()[1] > 0.05 * spread.singularValues()[0]) {
    const Eigen::Matrix4d t = Eigen::umeyama(a, b, true);
    scale = std::cbrt(t.topLeftCorner<3, 3>().determinant());
    turn = Eigen::Quaterniond(Eigen::Matrix3d(t.topLeftCorner<3, 3>() / scale)).normalized();
  }
  move(frames, scale, turn, centre_a, centre_b);
  shared_.offset_m -= centre_b - centre_a;
}

void PoseMap::addControl(const std::vector<FrameId>& free, Bundle& bundle) const {
  for (const auto& control : control_) {
    const auto place = control.check ? std::nullopt : controlPlace(control);
    if (!place) continue;
    const int point = static_cast<int>(bundle.points.size());
    bundle.points.push_back(*place);
    bundle.control.push_back({point, control.position, control.sigma_m});
    for (const auto& [id, pixel] : control.seen) {
      const auto it = std::find(free.begin(), free.end(), id);
      if (it != free.end())
        bundle.observations.push_back({static_cast<int>(it - free.begin()), point, pixel, kControlSigmaPx});
    }
  }
}

std::vector<FrameUpdate> PoseMap::adjustAll(Matcher& matcher) {
  const auto retry = [&] {
    int found = 0;
    for (bool progress = true; progress;) {
      progress = false;
      for (const FrameId id : std::vector<FrameId>(arrived_.begin(), arrived_.end())) {
        Frame& frame = frames_.at(id);
        if (frame.located || frame.reason.rfind("the same picture", 0) == 0 || located_count_ == 0) continue;
        if (!locate(id, matcher)) continue;
        extend(id, matcher);
        progress = true;
        ++found;
      }
    }
    return found;
  };
  retry();
  for (int c = 1; c <= components_; ++c) alignToTelemetry(c);
  auto all = locatedInOrder();
  const auto reportAll = [&] {
    open_.clear();
    std::vector<FrameUpdate> updates;
    for (const FrameId id : arrived_) updates.push_back(report(id));
    to_revise_.clear();
    return updates;
  };
  if (all.size() < 2) return reportAll();
  adjustRegion(all, options_.regional_observations, 2, true);
  for (const FrameId id : all) {
    if (options_.stop.stop_requested()) break;
    const std::size_t most = 2 * static_cast<std::size_t>(options_.link_frames);
    for (const FrameId other : overlapping(id, frames_.at(id).view, most, 1.0)) {
      Frame &a = frames_.at(id), &b = frames_.at(other);
      if (a.linked.contains(other)) continue;
      std::vector<Match> kept;
      for (const auto& m : guidedMatches(id, a.view, other, kCrossRadiusShare * lens_.model.width, matcher)) {
        const std::array<View, 2> views{a.view, b.view};
        const std::array<Eigen::Vector2d, 2> seen{normalise(a.keypoints[static_cast<std::size_t>(m.a)]),
                                                  normalise(b.keypoints[static_cast<std::size_t>(m.b)])};
        const auto x = triangulate(views, seen);
        if (x && residualPx(a, m.a, *x) < 2 * options_.gate_px &&
            residualPx(b, m.b, *x) < 2 * options_.gate_px)
          kept.push_back(m);
      }
      if (static_cast<int>(kept.size()) >= options_.least_points) join(id, other, kept);
    }
  }
  for (const FrameId id : all) triangulateTracks(id);
  adjustRegion(all, options_.global_observations, 3, true);
  if (retry() > 0) all = locatedInOrder();
  alignToControl(all);
  adjustRegion(all, options_.global_observations, 2, true);
  for (auto& control : control_) {
    const auto place = controlPlace(control);
    control.residual_m.reset();
    if (place) control.residual_m = *place - control.position;
  }
  return reportAll();
}

}  // namespace overfly::tiling::adjust
