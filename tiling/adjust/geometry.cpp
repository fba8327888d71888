#include "tiling/adjust/geometry.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

namespace overfly::tiling::adjust {
namespace {

std::vector<cv::Point2d> cvPoints(std::span<const Eigen::Vector2d> points) {
  std::vector<cv::Point2d> out;
  out.reserve(points.size());
  for (const auto& p : points) out.emplace_back(p.x(), p.y());
  return out;
}

Eigen::Matrix3d eigenFrom(const cv::Mat& m) {
  Eigen::Matrix3d out;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out(r, c) = m.at<double>(r, c);
  return out;
}

struct Candidate {
  Eigen::Matrix3d b_from_a;
  Eigen::Vector3d t;  // a's origin in b, any length
  RelativePose pose;
};

// Counts what the candidate explains and measures its parallax.
void judge(Candidate& c, std::span<const Eigen::Vector2d> in_a, std::span<const Eigen::Vector2d> in_b,
           double tolerance) {
  c.pose.a_from_b = Eigen::Quaterniond(c.b_from_a.transpose()).normalized();
  c.pose.b_in_a = -(c.b_from_a.transpose() * c.t).normalized();
  const std::array<View, 2> views{View{}, View{c.pose.b_in_a, c.pose.a_from_b}};
  std::vector<double> angles;
  for (std::size_t i = 0; i < in_a.size(); ++i) {
    const std::array<Eigen::Vector2d, 2> seen{in_a[i], in_b[i]};
    const auto x = triangulate(views, seen);
    if (!x) continue;
    const Eigen::Vector3d q = views[1].world_from_camera.conjugate() * (*x - views[1].position);
    const double error = std::max((x->hnormalized() - in_a[i]).norm(), (q.hnormalized() - in_b[i]).norm());
    if (error > tolerance) continue;
    ++c.pose.inliers;
    angles.push_back(parallax(views, *x));
  }
  if (angles.empty()) return;
  const auto middle = angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2);
  std::nth_element(angles.begin(), middle, angles.end());
  c.pose.median_parallax = *middle;
}

}  // namespace

std::optional<Eigen::Vector3d> triangulate(std::span<const View> views,
                                           std::span<const Eigen::Vector2d> seen) {
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Eigen::Vector3d ray = (views[i].world_from_camera * seen[i].homogeneous()).normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    a += across;
    b += across * views[i].position;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(a);
  if (eigen.eigenvalues()[0] < 1e-7 * static_cast<double>(views.size())) return std::nullopt;
  Eigen::Vector3d x = a.llt().solve(b);
  for (int step = 0; step < 2; ++step) {
    Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < views.size(); ++i) {
      const Eigen::Matrix3d r = views[i].world_from_camera.conjugate().toRotationMatrix();
      const Eigen::Vector3d p = r * (x - views[i].position);
      if (p.z() <= 1e-9) return std::nullopt;
      Eigen::Matrix<double, 2, 3> j;
      j << 1 / p.z(), 0, -p.x() / (p.z() * p.z()), 0, 1 / p.z(), -p.y() / (p.z() * p.z());
      j = j * r;
      h += j.transpose() * j;
      g += j.transpose() * (p.hnormalized() - seen[i]);
    }
    const Eigen::Vector3d dx = h.ldlt().solve(g);
    if (!dx.allFinite()) return std::nullopt;
    x -= dx;
  }
  for (const auto& view : views)
    if ((view.world_from_camera.conjugate() * (x - view.position)).z() <= 1e-9) return std::nullopt;
  return x;
}

double parallax(std::span<const View> views, const Eigen::Vector3d& point) {
  double smallest = 1;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t k = i + 1; k < views.size(); ++k)
      smallest = std::min(
          smallest, (views[i].position - point).normalized().dot((views[k].position - point).normalized()));
  return std::acos(std::clamp(smallest, -1.0, 1.0));
}

std::optional<RelativePose> relativePose(std::span<const Eigen::Vector2d> in_a,
                                         std::span<const Eigen::Vector2d> in_b,
                                         const RelativePoseHints& hints) {
  constexpr int kLeast = 20;
  if (static_cast<int>(in_a.size()) < kLeast) return std::nullopt;
  const auto a = cvPoints(in_a), b = cvPoints(in_b);
  const cv::Mat k = cv::Mat::eye(3, 3, CV_64F);
  std::vector<Candidate> candidates;
  const cv::Mat e = cv::findEssentialMat(a, b, k, cv::RANSAC, 0.999, hints.tolerance);
  for (int i = 0; i + 3 <= e.rows; i += 3) {
    cv::Mat r1, r2, t;
    cv::decomposeEssentialMat(e.rowRange(i, i + 3), r1, r2, t);
    const Eigen::Vector3d te(t.at<double>(0), t.at<double>(1), t.at<double>(2));
    for (const auto& r : {r1, r2})
      for (const double sign : {1.0, -1.0}) candidates.push_back({eigenFrom(r), sign * te, {}});
  }
  const cv::Mat h = cv::findHomography(a, b, cv::RANSAC, 2 * hints.tolerance, cv::noArray(), 2000, 0.999);
  if (!h.empty()) {
    std::vector<cv::Mat> rotations, translations, normals;
    cv::decomposeHomographyMat(h, k, rotations, translations, normals);
    for (std::size_t i = 0; i < rotations.size(); ++i) {
      const Eigen::Vector3d t(translations[i].at<double>(0), translations[i].at<double>(1),
                              translations[i].at<double>(2));
      if (t.norm() > 1e-6) candidates.push_back({eigenFrom(rotations[i]), t, {}});
    }
  }
  int best = 0;
  for (auto& c : candidates) {
    judge(c, in_a, in_b, 2 * hints.tolerance);
    best = std::max(best, c.pose.inliers);
  }
  if (best < kLeast) return std::nullopt;
  const Candidate* chosen = nullptr;
  double least = 0;
  for (const auto& c : candidates) {
    if (c.pose.inliers < 0.85 * best) continue;
    const double apart =
        std::acos(std::clamp((c.pose.a_from_b * hints.up_in_b).dot(hints.up_in_a), -1.0, 1.0));
    if (chosen == nullptr || apart < least) {
      chosen = &c;
      least = apart;
    }
  }
  return chosen->pose;
}

std::vector<int> verifiedMatches(std::span<const Eigen::Vector2d> in_a, std::span<const Eigen::Vector2d> in_b,
                                 double tolerance, int least) {
  std::vector<int> kept;
  if (static_cast<int>(in_a.size()) < std::max(8, least)) return kept;
  const auto a = cvPoints(in_a), b = cvPoints(in_b);
  cv::Mat by_plane, by_epipole;
  const cv::Mat h = cv::findHomography(a, b, cv::RANSAC, 4 * tolerance, by_plane, 1000, 0.999);
  const cv::Mat e =
      cv::findEssentialMat(a, b, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, 0.999, tolerance, by_epipole);
  for (int i = 0; i < static_cast<int>(a.size()); ++i) {
    const bool plane = !h.empty() && by_plane.at<unsigned char>(i) != 0;
    const bool epipole = !e.empty() && by_epipole.at<unsigned char>(i) != 0;
    if (plane || epipole) kept.push_back(i);
  }
  if (static_cast<int>(kept.size()) < least) kept.clear();
  return kept;
}

std::optional<Resection> resect(std::span<const Eigen::Vector3d> points,
                                std::span<const Eigen::Vector2d> seen, double tolerance, int least) {
  if (static_cast<int>(points.size()) < std::max(least, 6)) return std::nullopt;
  // Near the origin, so that nothing is lost in OpenCV's closed forms.
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const auto& p : points) centre += p;
  centre /= static_cast<double>(points.size());
  std::vector<cv::Point3d> object;
  for (const auto& p : points)
    object.emplace_back(p.x() - centre.x(), p.y() - centre.y(), p.z() - centre.z());
  const auto image = cvPoints(seen);
  const cv::Mat k = cv::Mat::eye(3, 3, CV_64F);
  cv::Mat rotation, translation;
  std::vector<int> inliers;
  if (!cv::solvePnPRansac(object, image, k, cv::noArray(), rotation, translation, false, 1000,
                          static_cast<float>(tolerance), 0.999, inliers, cv::SOLVEPNP_AP3P))
    return std::nullopt;
  if (static_cast<int>(inliers.size()) < least) return std::nullopt;
  std::vector<cv::Point3d> good_object;
  std::vector<cv::Point2d> good_image;
  for (const int i : inliers) {
    good_object.push_back(object[static_cast<std::size_t>(i)]);
    good_image.push_back(image[static_cast<std::size_t>(i)]);
  }
  cv::solvePnPRefineLM(good_object, good_image, k, cv::noArray(), rotation, translation);
  cv::Mat r;
  cv::Rodrigues(rotation, r);
  Resection out;
  const Eigen::Matrix3d camera_from_world = eigenFrom(r);
  const Eigen::Vector3d t(translation.at<double>(0), translation.at<double>(1), translation.at<double>(2));
  out.view.world_from_camera = Eigen::Quaterniond(camera_from_world.transpose()).normalized();
  out.view.position = centre - camera_from_world.transpose() * t;
  if (!out.view.position.allFinite()) return std::nullopt;
  out.inliers = std::move(inliers);
  return out;
}

}  // namespace overfly::tiling::adjust
