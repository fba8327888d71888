#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

namespace overfly::tiling::adjust {

using FrameId = std::uint64_t;

// A borrowed 8-bit grey picture.
struct GreyImage {
  const std::uint8_t* data = nullptr;
  int width = 0;  // pixels
  int height = 0;
  int stride = 0;  // bytes per row
};

enum class FeatureKind { Sift, Akaze, Orb };

struct FeatureOptions {
  FeatureKind kind = FeatureKind::Sift;  // docs/adjustment.md: time against accuracy of the three
  int long_side_px = 800;                // features are sought on a copy reduced to this (never enlarged)
  int most = 2500;                       // the strongest features that are kept
};

struct Features {
  std::vector<Eigen::Vector2d> pixels;  // in the full picture, first pixel's centre at (0.5, 0.5)
  std::vector<float> strength;          // decreasing
  int length = 0;                       // descriptor: floats (SIFT, unit length) or bytes
  std::vector<float> real;              // SIFT: row-major, one descriptor after the other
  std::vector<std::uint8_t> binary;     // AKAZE, ORB
};

[[nodiscard]] Features findFeatures(const GreyImage& image, const FeatureOptions& options);

struct Match {
  int a = 0, b = 0;  // indices of keypoints in the two frames
};

// Where a keypoint of frame a ought to lie in frame b; nullopt: outside.
struct MatchGuide {
  std::function<std::optional<Eigen::Vector2d>(int keypoint_in_a)> predict;
  double radius_px = 0;
};

struct MatchOptions {
  double ratio = 0.85;       // second best over best descriptor distance (Lowe)
  int most_unguided = 1200;  // only the strongest are compared without a guide
};

// Descriptor matches that are each other's best, unverified, in the order of a's keypoints.
[[nodiscard]] std::vector<Match> matchFeatures(const Features& a, const Features& b, const MatchGuide* guide,
                                               int width, int height, const MatchOptions& options);

// Gives matches between frames that were seen; from images, or from a simulation's truth.
class Matcher {
 public:
  virtual ~Matcher() = default;
  Matcher() = default;
  Matcher(const Matcher&) = delete;
  Matcher& operator=(const Matcher&) = delete;
  [[nodiscard]] virtual std::vector<Match> match(FrameId a, FrameId b, const MatchGuide* guide) = 0;
  virtual void forget(FrameId id) = 0;
};

}  // namespace overfly::tiling::adjust
