#include <algorithm>
#include <cmath>

#include "tiling/adjust/pose_map.h"

// What connects frames: prediction, overlap, matches, tracks and their points.
namespace overfly::tiling::adjust {
namespace {

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Eigen::Vector2d PoseMap::normalise(const Eigen::Vector2d& pixel,
                                   const Eigen::Matrix<double, Lens::kSize, 1>& lens) const {
  const double fx = lens[0], fy = fx * lens_.model.fy / lens_.model.fx;
  Eigen::Vector2d p((pixel.x() - lens[1]) / fx, (pixel.y() - lens[2]) / fy);
  for (int i = 0; i < 12; ++i) {
    const auto px = projectWith(lens_, lens, p.homogeneous());
    if (!px) break;
    const Eigen::Vector2d step((pixel.x() - px->x()) / fx, (pixel.y() - px->y()) / fy);
    p += step;
    if (step.squaredNorm() < 1e-18) break;
  }
  return p;
}

double PoseMap::residualPx(const Frame& frame, int keypoint, const Eigen::Vector3d& point) const {
  const auto px = projectWith(lens_, shared_.lens,
                              frame.view.world_from_camera.conjugate() * (point - frame.view.position));
  return px ? (*px - frame.keypoints[static_cast<std::size_t>(keypoint)]).norm() : 1e9;
}

// Median height of the points that the located frame nearest to `near` sees.
double PoseMap::groundHeight(const Eigen::Vector3d& near) const {
  const Frame* nearest = nullptr;
  double least = 1e300;
  for (const auto& [id, frame] : frames_) {
    if (!frame.located) continue;
    const double d = (frame.view.position - near).head<2>().squaredNorm();
    if (d < least) {
      least = d;
      nearest = &frame;
    }
  }
  std::vector<double> heights;
  if (nearest != nullptr)
    for (const int t : nearest->tracks)
      if (t >= 0 && tracks_[static_cast<std::size_t>(t)].known)
        heights.push_back(tracks_[static_cast<std::size_t>(t)].point.z());
  return heights.size() < 5 ? near.z() - 50 : median(std::move(heights));
}

// The telemetry's motion since the located frame nearest in time, put onto that frame's adjusted pose.
View PoseMap::predicted(FrameId id) const {
  const Frame& frame = frames_.at(id);
  if (frame.located) return frame.view;
  const Frame* nearest = nullptr;
  std::int64_t least = 0;
  for (const auto& [other, candidate] : frames_) {
    if (!candidate.located) continue;
    const std::int64_t apart = std::abs(candidate.prior.time_ns - frame.prior.time_ns);
    if (nearest == nullptr || apart < least) {
      least = apart;
      nearest = &candidate;
    }
  }
  if (nearest == nullptr) return {frame.prior.position, frame.prior.enu_from_camera};
  View view;
  view.position = nearest->view.position + frame.prior.position - nearest->prior.position;
  view.world_from_camera = (frame.prior.enu_from_camera * nearest->prior.enu_from_camera.conjugate() *
                            nearest->view.world_from_camera)
                               .normalized();
  return view;
}

// How far, in pixels, a predicted place may be off: from recent predictions, else from the claims.
double PoseMap::predictionRadius(FrameId id) const {
  if (innovations_px_.size() >= 3)
    return std::max(30.0, 4 * *std::max_element(innovations_px_.begin(), innovations_px_.end()));
  const Frame& frame = frames_.at(id);
  const auto sigma = frame.prior.covariance.diagonal().cwiseSqrt();
  const double height = std::max(1.0, frame.prior.position.z() - groundHeight(frame.prior.position));
  return 3 * shared_.lens[0] *
         (std::sqrt(2.0) * sigma.head<2>().maxCoeff() / height + sigma.tail<3>().norm());
}

// Located frames that see the same ground, the most telling first: near, but not all on the same side.
std::vector<FrameId> PoseMap::overlapping(FrameId id, const View& view, std::size_t most,
                                          double slack) const {
  const double ground = groundHeight(view.position);
  const double side = std::sqrt(static_cast<double>(lens_.model.width) * lens_.model.height);
  const auto footprint = [&](const View& v) {
    const Eigen::Vector3d axis = v.world_from_camera * Eigen::Vector3d::UnitZ();
    const double height = std::max(1.0, v.position.z() - ground);
    // Towards the horizon the footprint is cut at four heights.
    const double reach = axis.z() < -0.25 ? height / -axis.z() : 4 * height;
    return Eigen::Vector4d((v.position + reach * axis).x(), (v.position + reach * axis).y(),
                           0.5 * reach * side / shared_.lens[0], 0);
  };
  const Eigen::Vector4d here = footprint(view);
  struct Candidate {
    FrameId id;
    Eigen::Vector2d centre;
    double apart;  // in sums of footprint radii
    double value;
  };
  std::vector<Candidate> candidates;
  for (const auto& [other, frame] : frames_) {
    if (other == id || !frame.located) continue;
    const Eigen::Vector4d there = footprint(frame.view);
    const double apart = (there - here).head<2>().norm() / (there.z() + here.z());
    if (apart < 0.8 * slack) candidates.push_back({other, there.head<2>(), apart, apart});
  }
  std::vector<FrameId> chosen;
  while (!candidates.empty() && chosen.size() < most) {
    const auto best = std::min_element(candidates.begin(), candidates.end(),
                                       [](const auto& a, const auto& b) { return a.value < b.value; });
    const Candidate taken = *best;
    candidates.erase(best);
    chosen.push_back(taken.id);
    for (auto& c : candidates) {
      const double near = (c.centre - taken.centre).norm() / (2 * here.z());
      c.value = std::max(c.value, c.apart + 0.6 * std::max(0.0, 0.4 - near));
    }
  }
  return chosen;
}

std::vector<Match> PoseMap::guidedMatches(FrameId a, const View& view_a, FrameId b, double radius_px,
                                          Matcher& matcher) const {
  const Frame &fa = frames_.at(a), &fb = frames_.at(b);
  const double ground = groundHeight(view_a.position);
  const double margin = radius_px;
  MatchGuide guide;
  guide.radius_px = radius_px;
  guide.predict = [&](int k) -> std::optional<Eigen::Vector2d> {
    const int t = fa.tracks[static_cast<std::size_t>(k)];
    Eigen::Vector3d x;
    if (t >= 0 && tracks_[static_cast<std::size_t>(t)].known) {
      x = tracks_[static_cast<std::size_t>(t)].point;
    } else {
      const Eigen::Vector3d ray =
          view_a.world_from_camera * normalise(fa.keypoints[static_cast<std::size_t>(k)]).homogeneous();
      if (ray.z() > -0.05 * ray.norm()) return std::nullopt;
      x = view_a.position + ray * ((ground - view_a.position.z()) / ray.z());
    }
    const auto px =
        projectWith(lens_, shared_.lens, fb.view.world_from_camera.conjugate() * (x - fb.view.position));
    if (!px || px->x() < -margin || px->y() < -margin || px->x() > lens_.model.width + margin ||
        px->y() > lens_.model.height + margin)
      return std::nullopt;
    return px;
  };
  return matcher.match(a, b, &guide);
}

std::vector<Match> PoseMap::freeMatches(FrameId a, FrameId b, Matcher& matcher) {
  const auto matches = matcher.match(a, b, nullptr);
  const Frame &fa = frames_.at(a), &fb = frames_.at(b);
  std::vector<Eigen::Vector2d> in_a, in_b;
  for (const auto& m : matches) {
    in_a.push_back(normalise(fa.keypoints[static_cast<std::size_t>(m.a)]));
    in_b.push_back(normalise(fb.keypoints[static_cast<std::size_t>(m.b)]));
  }
  std::vector<Match> kept;
  for (const int i : verifiedMatches(in_a, in_b, 1.5 / shared_.lens[0], options_.least_points))
    kept.push_back(matches[static_cast<std::size_t>(i)]);
  return kept;
}

void PoseMap::dropSighting(int track, std::size_t index) {
  Track& t = tracks_[static_cast<std::size_t>(track)];
  const Sighting s = t.seen[index];
  frames_.at(s.frame).tracks[static_cast<std::size_t>(s.keypoint)] = -1;
  t.seen.erase(t.seen.begin() + static_cast<std::ptrdiff_t>(index));
}

void PoseMap::dropTrack(int track) {
  Track& t = tracks_[static_cast<std::size_t>(track)];
  for (const auto& s : t.seen) frames_.at(s.frame).tracks[static_cast<std::size_t>(s.keypoint)] = -1;
  t = {};
  free_tracks_.push_back(track);
}

void PoseMap::join(FrameId a, FrameId b, const std::vector<Match>& matches) {
  Frame &fa = frames_.at(a), &fb = frames_.at(b);
  fa.linked.insert(b);
  fb.linked.insert(a);
  const auto sees = [](const Track& t, FrameId id) {
    return std::any_of(t.seen.begin(), t.seen.end(), [&](const Sighting& s) { return s.frame == id; });
  };
  const auto extendTrack = [&](int track, FrameId id, Frame& frame, int keypoint) {
    Track& t = tracks_[static_cast<std::size_t>(track)];
    if (sees(t, id)) return;
    if (t.known && frame.located && residualPx(frame, keypoint, t.point) > options_.gate_px) return;
    t.seen.push_back({id, keypoint});
    frame.tracks[static_cast<std::size_t>(keypoint)] = track;
  };
  for (const auto& m : matches) {
    const int ta = fa.tracks[static_cast<std::size_t>(m.a)], tb = fb.tracks[static_cast<std::size_t>(m.b)];
    if (ta < 0 && tb < 0) {
      int track = static_cast<int>(tracks_.size());
      if (free_tracks_.empty()) {
        tracks_.emplace_back();
      } else {
        track = free_tracks_.back();
        free_tracks_.pop_back();
      }
      tracks_[static_cast<std::size_t>(track)].seen = {{a, m.a}, {b, m.b}};
      fa.tracks[static_cast<std::size_t>(m.a)] = fb.tracks[static_cast<std::size_t>(m.b)] = track;
    } else if (tb < 0) {
      extendTrack(ta, b, fb, m.b);
    } else if (ta < 0) {
      extendTrack(tb, a, fa, m.a);
    } else if (ta != tb) {
      Track &into = tracks_[static_cast<std::size_t>(ta)], &from = tracks_[static_cast<std::size_t>(tb)];
      if (std::any_of(from.seen.begin(), from.seen.end(), [&](const auto& s) { return sees(into, s.frame); }))
        continue;
      if (into.known && from.known && fa.located && fb.located &&
          (residualPx(fa, m.a, from.point) > options_.gate_px ||
           residualPx(fb, m.b, into.point) > options_.gate_px))
        continue;
      for (const auto& s : from.seen) {
        frames_.at(s.frame).tracks[static_cast<std::size_t>(s.keypoint)] = ta;
        into.seen.push_back(s);
      }
      if (!into.known && from.known) {
        into.known = true;
        into.point = from.point;
      }
      from = {};
      free_tracks_.push_back(tb);
    }
  }
}

bool PoseMap::makePoint(int track) {
  Track& t = tracks_[static_cast<std::size_t>(track)];
  for (int tries = 0; tries < 2; ++tries) {
    std::vector<View> views;
    std::vector<Eigen::Vector2d> seen;
    std::vector<std::size_t> index;
    for (std::size_t i = 0; i < t.seen.size(); ++i) {
      const Frame& frame = frames_.at(t.seen[i].frame);
      if (!frame.located) continue;
      views.push_back(frame.view);
      seen.push_back(normalise(frame.keypoints[static_cast<std::size_t>(t.seen[i].keypoint)]));
      index.push_back(i);
    }
    t.known = false;
    if (views.size() < 2) return false;
    const auto x = triangulate(views, seen);
    if (!x || parallax(views, *x) < options_.least_parallax) return false;
    double worst = 0;
    std::size_t worst_at = 0;
    for (const std::size_t i : index) {
      const double r = residualPx(frames_.at(t.seen[i].frame), t.seen[i].keypoint, *x);
      if (r > worst) {
        worst = r;
        worst_at = i;
      }
    }
    if (worst <= options_.gate_px) {
      t.point = *x;
      t.known = true;
      return true;
    }
    if (views.size() < 3) {
      dropTrack(track);  // two views that disagree: a wrong match
      return false;
    }
    dropSighting(track, worst_at);
  }
  return false;
}

void PoseMap::triangulateTracks(FrameId id) {
  for (const int t : std::vector<int>(frames_.at(id).tracks))
    if (t >= 0 && !tracks_[static_cast<std::size_t>(t)].known &&
        tracks_[static_cast<std::size_t>(t)].seen.size() > 1)
      makePoint(t);
}

}  // namespace overfly::tiling::adjust
