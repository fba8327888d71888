#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <vector>

#include "capture/camera_model.h"
#include "tiling/adjust/bundle.h"
#include "tiling/adjust/features.h"
#include "tiling/adjust/geometry.h"

namespace overfly::tiling::adjust {

// What the autopilot (or the camera's own GPS) says of one moment, in the adjustment's local ENU frame.
struct PriorPose {
  std::int64_t time_ns = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // metres
  Eigen::Quaterniond enu_from_camera = Eigen::Quaterniond::Identity();
  // Position (m^2), then rotation vector on the ENU side (rad^2): what the device claims, all errors
  // together. How much of it changes from frame to frame is estimated (PoseMap).
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
};

// Settings with the effect of raising them. The defaults serve every flight alike.
struct AdjustOptions {
  int window_frames = 8;            // newest frames that one frame's adjustment moves: smoother, slower
  int fixed_neighbours = 10;        // older frames that hold the window in place
  int regional_every = 20;          // frames between two regional adjustments (with lens, boresight, delay)
  int regional_frames = 80;         // frames that a regional adjustment moves: less drift, slower
  int retained_frames = 250;        // frames whose features stay for matching with later legs: memory
  int link_frames = 8;              // frames that each new frame is matched with
  int window_observations = 200;    // measurements per frame in a window's adjustment
  int regional_observations = 150;  // the same in a regional one
  int global_observations = 1000;   // the same in the adjustment of the whole flight
  int least_points = 15;            // agreeing measurements below which a frame is not adjusted
  double sigma_px = 0.6;            // noise of a feature's place, pixels
  double gate_px = 4.0;             // measurements further from their prediction are not joined to a point
  double least_parallax = 0.026;    // radians (1.5 degrees) below which a track has no point yet
  // A closed pose is revised when it has moved by more than this on the ground since it was reported; with it
  // go those that have moved by more than half of it (hysteresis).
  double revise_px = 1.0;
  int threads = 1;
  std::stop_token stop;  // breaks off what is being adjusted; the map is to be thrown away then

  // Priors on what all frames share (1 sigma); zero holds a value at its nominal.
  // Absolute 1-sigma values in the order of Lens (a calibrated lens: LensProfile) instead of the next three.
  std::optional<Eigen::Matrix<double, Lens::kSize, 1>> sigma_lens;
  double sigma_focal = 0.02;       // relative
  double sigma_principal = 0.015;  // relative to the image's long side
  std::array<double, 5> sigma_distortion{0.1, 0.1, 0.005, 0.005, 0};
  double sigma_boresight = 0.05;  // radians
  double sigma_lever_m = 0.2;
  double sigma_delay_s =
      3;  // a camera's own GPS lags by seconds; an autopilot's shows its little delay itself
};

enum class FrameState {
  Waiting,  // not enough neighbours yet
  Adjusted,
  PriorOnly,  // images do not say; telemetry, moved along with its adjusted neighbours
  HeldBack,   // neither images nor telemetry are good enough to sweep with
};

struct FrameUpdate {
  FrameId id = 0;
  FrameState state = FrameState::Waiting;
  std::string reason;                                  // why it is not adjusted; empty when it is
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // ENU, metres
  Eigen::Quaterniond enu_from_camera = Eigen::Quaterniond::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  double shift_px = 0;   // on the ground, against what was reported before (first: against the telemetry)
  int revision = 0;      // 0: first report of this frame
  int observations = 0;  // image measurements that hold it
  double rms_px = 0;     // root mean square length of its residuals
  capture::CameraModel camera;  // the lens as it was calibrated together with this pose
};

// Poses, points and tracks of one camera's flight, in one local ENU frame. Frames come in one by one; each
// is matched with the frames that overlap it, located from points already known (resection), and adjusted
// with the newest ones while older neighbours hold the window. Every regional_every frames a larger region
// is adjusted together with the lens, the boresight, the lever arm and the telemetry's delay, and the
// telemetry's noise is re-estimated from its own residuals (variance components), so that RTK, single GNSS
// and a phone's GPS need no setting. Work and memory per frame are bounded by the options.
// Thread rule: one thread. Deterministic for a given order of frames.
class PoseMap {
 public:
  PoseMap(const capture::CameraModel& camera, const AdjustOptions& options);

  // Adds a frame with its keypoints (pixels; index = keypoint) and returns the frames that closed or were
  // revised. A frame whose id is known, or whose picture equals its predecessor's (duplicate), is reported.
  std::vector<FrameUpdate> add(FrameId id, const PriorPose& prior, std::vector<Eigen::Vector2d> keypoints,
                               Matcher& matcher);
  // Reports a frame whose window has not closed yet: revision 0, its closing is then reported as a revision
  // if it has moved. One that would be held back is described, not reported: it stays open. nullopt: unknown,
  // or reported before.
  std::optional<FrameUpdate> reportEarly(FrameId id);
  // Closes the window: everything still open is reported.
  std::vector<FrameUpdate> finish();

  // After the flight: links all overlapping frames, adjusts all of them together, reports every frame.
  // Only meaningful while nothing was forgotten (retained_frames at least the number of frames).
  std::vector<FrameUpdate> adjustAll(Matcher& matcher);

  struct Summary {
    int frames = 0, adjusted = 0, points = 0, observations = 0;
    double rms_px = 0;  // root mean square length of the residuals of the last large adjustment
    SharedParameters shared;
    SharedSigmas sigmas;
    // Noise of the telemetry from frame to frame as estimated: metres, radians.
    double noise_horizontal_m = 0, noise_vertical_m = 0, noise_tilt = 0, noise_heading = 0;
    double ground_height_m = 0;  // median height of the points, ENU
    DomeUncertainty dome;        // after adjustAll()
  };
  [[nodiscard]] Summary summary() const;
  [[nodiscard]] double rmsPx() const { return rms_px_; }  // Summary::rms_px alone, at no cost
  [[nodiscard]] capture::CameraModel camera() const { return lens_.with(shared_.lens); }
  // Points with at least `least_views` measurements, ENU.
  [[nodiscard]] std::vector<Eigen::Vector3d> points(int least_views) const;

  // Ground control: where known points were seen. Used by adjustAll().
  struct Control {
    std::string name;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  // ENU
    Eigen::Vector3d sigma_m = Eigen::Vector3d::Constant(0.03);
    bool check = false;  // only reported, not used
    std::vector<std::pair<FrameId, Eigen::Vector2d>> seen;
    std::optional<Eigen::Vector3d> residual_m;  // after adjustAll: adjusted minus given
  };
  std::vector<Control>& control() { return control_; }
  [[nodiscard]] const std::vector<Control>& control() const { return control_; }

 private:
  struct Frame {
    PriorPose prior;
    std::vector<Eigen::Vector2d> keypoints;  // pixels
    std::vector<int> tracks;                 // per keypoint; -1: none
    View view;
    bool located = false;
    bool closed = false;
    int order = 0;  // of arrival
    int component = 0;
    int attempts = 0;  // to locate it
    std::string reason;
    Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
    std::set<FrameId> linked;
    struct Reported {
      View view;
      Eigen::Matrix<double, Lens::kSize, 1> lens;
      bool located = false;
    };
    std::optional<Reported> reported;
    int revision = 0;
  };
  struct Sighting {
    FrameId frame;
    int keypoint;
  };
  struct Track {
    std::vector<Sighting> seen;
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    bool known = false;  // has a point
  };

  // pose_map.cpp: the flow
  [[nodiscard]] bool isSamePicture(FrameId a, FrameId b, const std::vector<Match>& matches) const;
  bool bootstrap(FrameId id, Matcher& matcher);
  bool locate(FrameId id, Matcher& matcher);
  void extend(FrameId id, Matcher& matcher);
  void retryWaiting(Matcher& matcher);
  std::vector<FrameUpdate> close(bool all);
  void forgetOld(Matcher& matcher);
  [[nodiscard]] FrameUpdate describe(FrameId id) const;
  FrameUpdate report(FrameId id, bool closed = true);
  // pose_map_links.cpp: overlap, prediction, tracks
  [[nodiscard]] View predicted(FrameId id) const;
  [[nodiscard]] double predictionRadius(FrameId id) const;
  [[nodiscard]] std::vector<FrameId> overlapping(FrameId id, const View& view, std::size_t most,
                                                 double slack) const;
  [[nodiscard]] std::vector<Match> guidedMatches(FrameId a, const View& view_a, FrameId b, double radius_px,
                                                 Matcher& matcher) const;
  [[nodiscard]] std::vector<Match> freeMatches(FrameId a, FrameId b, Matcher& matcher);
  void join(FrameId a, FrameId b, const std::vector<Match>& matches);
  void triangulateTracks(FrameId id);
  bool makePoint(int track);
  void dropSighting(int track, std::size_t index);
  void dropTrack(int track);
  [[nodiscard]] Eigen::Vector2d normalise(const Eigen::Vector2d& pixel) const {
    return normalise(pixel, shared_.lens);
  }
  [[nodiscard]] Eigen::Vector2d normalise(const Eigen::Vector2d& pixel,
                                          const Eigen::Matrix<double, Lens::kSize, 1>& lens) const;
  [[nodiscard]] double groundHeight(const Eigen::Vector3d& near) const;
  [[nodiscard]] double residualPx(const Frame& frame, int keypoint, const Eigen::Vector3d& point) const;
  // pose_map_adjust.cpp: least squares; pose_map_telemetry.cpp: what the telemetry says
  void adjustWindow();
  void adjustRegion(const std::vector<FrameId>& free, int observations, int rounds, bool all);
  // `others`: constant, or (`soft`) held by their own uncertainty.
  [[nodiscard]] Bundle makeBundle(const std::vector<FrameId>& free, const std::vector<FrameId>& others,
                                  bool soft, int observations, std::vector<int>& tracks) const;
  [[nodiscard]] BundleFrame::Hold holdOf(const Frame& frame, std::size_t held_frames) const;
  void takeBack(const Bundle& bundle, const std::vector<FrameId>& frames, const std::vector<int>& tracks);
  void refreshPoints(const std::vector<FrameId>& frames);
  int prune(const std::vector<FrameId>& frames, double limit_px);
  void alignToTelemetry(int component);
  void move(const std::vector<FrameId>& members, double scale, const Eigen::Quaterniond& turn,
            const Eigen::Vector3d& from, const Eigen::Vector3d& to);
  [[nodiscard]] std::optional<Eigen::Vector3d> controlPlace(const Control& control) const;
  void alignToControl(const std::vector<FrameId>& frames);
  void addControl(const std::vector<FrameId>& free, Bundle& bundle) const;
  void estimateNoise(const std::vector<FrameId>& frames);
  void searchDelay(const std::vector<FrameId>& frames);
  [[nodiscard]] std::vector<FrameId> neighboursOf(const std::vector<FrameId>& frames, std::size_t most) const;
  void fillPrior(const Frame& frame, BundleFrame& out) const;
  // Where the adjusted track was `delay_s` before a frame, and how it moved then.
  struct Earlier {
    Eigen::Vector3d displacement = Eigen::Vector3d::Zero();  // of the camera centre, against the frame's own
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();  // enu_from_camera then = turn * now
    double beyond_s = 0;                                       // how far outside the track
    double velocity_change = 0;  // m/s between neighbouring stretches: how little the velocity is known
  };
  [[nodiscard]] Earlier earlier(const Frame& frame, double delay_s) const;
  // Largest way that the picture's corners and centre move on the ground, pixels; `to` goes with the present
  // lens.
  [[nodiscard]] double shiftPx(const Frame::Reported& from, const View& to) const;
  [[nodiscard]] std::vector<FrameId> locatedInOrder() const;

  AdjustOptions options_;
  Lens lens_;
  SharedParameters shared_, prior_;
  SharedSigmas prior_sigmas_, sigmas_;
  struct Noise {  // factors on the covariances that the telemetry claims
    double horizontal = 1, vertical = 1, tilt = 1, heading = 1;
  } noise_;
  struct Wander {  // by how much the noise counts for more, because it is correlated in time
    double horizontal = 1, vertical = 1, attitude = 1;
  } wander_;
  std::map<FrameId, Frame> frames_;
  std::map<std::int64_t, FrameId> located_at_;  // the adjusted track: located frames by time
  std::vector<Track> tracks_;
  std::vector<int> free_tracks_;
  std::deque<FrameId> open_;           // not closed, in order of arrival
  std::deque<FrameId> arrived_;        // retained frames in order of arrival
  std::deque<double> innovations_px_;  // how far predictions were off, newest last
  std::set<FrameId> to_revise_;
  int arrivals_ = 0, located_count_ = 0, next_regional_ = 6, components_ = 0;
  double rms_px_ = 0;
  DomeUncertainty dome_;
  double delay_sigma_ = 0;  // of the delay's prior, once the track's shape was looked at
  std::vector<Control> control_;
};

}  // namespace overfly::tiling::adjust
