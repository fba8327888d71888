#include "tiling/adjust/features.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

namespace overfly::tiling::adjust {
namespace {

// Keypoints of one frame in square cells, for searches around a predicted place.
class Grid {
 public:
  Grid(const std::vector<Eigen::Vector2d>& pixels, int width, int height, double cell)
      : cell_(std::max(8.0, cell)),
        columns_(static_cast<int>(width / cell_) + 1),
        rows_(static_cast<int>(height / cell_) + 1),
        cells_(static_cast<std::size_t>(columns_ * rows_)) {
    for (std::size_t i = 0; i < pixels.size(); ++i)
      cells_[index(column(pixels[i].x()), row(pixels[i].y()))].push_back(static_cast<int>(i));
  }
  template <class F>
  void near(const Eigen::Vector2d& at, double radius, F&& visit) const {
    for (int r = row(at.y() - radius); r <= row(at.y() + radius); ++r)
      for (int c = column(at.x() - radius); c <= column(at.x() + radius); ++c)
        for (const int i : cells_[index(c, r)]) visit(i);
  }

 private:
  [[nodiscard]] int column(double x) const {
    return std::clamp(static_cast<int>(x / cell_), 0, columns_ - 1);
  }
  [[nodiscard]] int row(double y) const { return std::clamp(static_cast<int>(y / cell_), 0, rows_ - 1); }
  [[nodiscard]] std::size_t index(int c, int r) const { return static_cast<std::size_t>(r * columns_ + c); }
  double cell_;
  int columns_, rows_;
  std::vector<std::vector<int>> cells_;
};

// Squared descriptor distance: of unit vectors, or the number of differing bits.
float distance2(const Features& a, int i, const Features& b, int k) {
  const auto n = a.length;
  if (!a.real.empty()) {
    const Eigen::Map<const Eigen::VectorXf> x(a.real.data() + static_cast<std::ptrdiff_t>(i) * n, n);
    const Eigen::Map<const Eigen::VectorXf> y(b.real.data() + static_cast<std::ptrdiff_t>(k) * n, n);
    return 2 - 2 * x.dot(y);
  }
  const std::uint8_t* x = a.binary.data() + static_cast<std::ptrdiff_t>(i) * n;
  const std::uint8_t* y = b.binary.data() + static_cast<std::ptrdiff_t>(k) * n;
  int bits = 0, at = 0;
  for (; at + 8 <= n; at += 8) {
    std::uint64_t u = 0, v = 0;
    std::memcpy(&u, x + at, 8);
    std::memcpy(&v, y + at, 8);
    bits += std::popcount(u ^ v);
  }
  for (; at < n; ++at) bits += std::popcount(static_cast<unsigned>(x[at] ^ y[at]));
  return static_cast<float>(bits) * static_cast<float>(bits);
}

struct Best {
  float first = 1e30F, second = 1e30F;
  int index = -1;
  void offer(float d, int i) {
    if (d < first) {
      second = first;
      first = d;
      index = i;
    } else if (d < second) {
      second = d;
    }
  }
};

std::vector<Match> mutual(const std::vector<Best>& of_a, const std::vector<Best>& of_b, double ratio) {
  std::vector<Match> matches;
  const auto limit = static_cast<float>(ratio * ratio);
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    const auto& best = of_a[i];
    if (best.index < 0 || best.first > limit * best.second) continue;
    if (of_b[static_cast<std::size_t>(best.index)].index != static_cast<int>(i)) continue;
    matches.push_back({static_cast<int>(i), best.index});
  }
  return matches;
}

}  // namespace

Features findFeatures(const GreyImage& image, const FeatureOptions& options) {
  const cv::Mat full(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.data),
                     static_cast<std::size_t>(image.stride));
  const double scale = std::min(1.0, static_cast<double>(options.long_side_px) /
                                         static_cast<double>(std::max(image.width, image.height)));
  cv::Mat small = full;
  if (scale < 1) cv::resize(full, small, {}, scale, scale, cv::INTER_AREA);
  const double sx = static_cast<double>(image.width) / small.cols,
               sy = static_cast<double>(image.height) / small.rows;

  cv::Ptr<cv::Feature2D> detector;
  switch (options.kind) {
    case FeatureKind::Sift:
      detector = cv::SIFT::create(0, 3, 0.02);
      break;
    case FeatureKind::Akaze:
      detector = cv::AKAZE::create(cv::AKAZE::DESCRIPTOR_MLDB, 0, 3, 0.0005F);
      break;
    case FeatureKind::Orb:
      detector = cv::ORB::create(options.most * 2, 1.2F, 6);
      break;
  }
  std::vector<cv::KeyPoint> found;
  detector->detect(small, found);
  // The strongest of each cell first, so that a textured corner does not take all.
  constexpr int kCells = 12;
  std::vector<std::vector<std::size_t>> cells(kCells * kCells);
  for (std::size_t i = 0; i < found.size(); ++i) {
    const int c =
        std::min(kCells - 1, static_cast<int>(found[i].pt.x / static_cast<float>(small.cols) * kCells));
    const int r =
        std::min(kCells - 1, static_cast<int>(found[i].pt.y / static_cast<float>(small.rows) * kCells));
    cells[static_cast<std::size_t>(r * kCells + c)].push_back(i);
  }
  std::vector<std::pair<std::size_t, std::size_t>> ranked;  // rank in its cell, index
  for (auto& cell : cells) {
    std::stable_sort(cell.begin(), cell.end(),
                     [&](std::size_t a, std::size_t b) { return found[a].response > found[b].response; });
    for (std::size_t rank = 0; rank < cell.size(); ++rank) ranked.emplace_back(rank, cell[rank]);
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  if (ranked.size() > static_cast<std::size_t>(options.most))
    ranked.resize(static_cast<std::size_t>(options.most));
  std::vector<cv::KeyPoint> kept;
  for (const auto& [rank, index] : ranked) kept.push_back(found[index]);
  cv::Mat descriptors;
  detector->compute(small, kept, descriptors);

  Features out;
  out.length = descriptors.cols;
  // OpenCV: the first pixel's centre is (0, 0). Its SIFT works on a doubled picture whose pixel i lies at
  // i / 2 - 1/4 of the small one, and says i / 2 (unless built with "enable_precise_upscale", which came
  // later).
  const double centre = options.kind == FeatureKind::Sift ? 0.25 : 0.5;
  for (const auto& k : kept) {
    out.pixels.emplace_back((k.pt.x + centre) * sx, (k.pt.y + centre) * sy);
    out.strength.push_back(k.response);
  }
  for (int r = 0; r < descriptors.rows; ++r) {
    if (descriptors.type() == CV_32F) {
      // RootSIFT (Arandjelovic and Zisserman 2012): square roots of the L1-normalised histogram.
      const float* row = descriptors.ptr<float>(r);
      const float sum = std::accumulate(row, row + descriptors.cols, 1e-12F);
      for (int c = 0; c < descriptors.cols; ++c) out.real.push_back(std::sqrt(std::max(0.0F, row[c]) / sum));
    } else {
      const std::uint8_t* row = descriptors.ptr<std::uint8_t>(r);
      out.binary.insert(out.binary.end(), row, row + descriptors.cols);
    }
  }
  return out;
}

std::vector<Match> matchFeatures(const Features& a, const Features& b, const MatchGuide* guide, int width,
                                 int height, const MatchOptions& options) {
  if (a.pixels.empty() || b.pixels.empty()) return {};
  std::vector<Best> of_a(a.pixels.size()), of_b(b.pixels.size());
  if (guide != nullptr) {
    const Grid grid(b.pixels, width, height, guide->radius_px);
    const double r2 = guide->radius_px * guide->radius_px;
    for (std::size_t i = 0; i < a.pixels.size(); ++i) {
      const auto at = guide->predict(static_cast<int>(i));
      if (!at) continue;
      grid.near(*at, guide->radius_px, [&](int k) {
        if ((b.pixels[static_cast<std::size_t>(k)] - *at).squaredNorm() > r2) return;
        const float d = distance2(a, static_cast<int>(i), b, k);
        of_a[i].offer(d, k);
        of_b[static_cast<std::size_t>(k)].offer(d, static_cast<int>(i));
      });
    }
    // A lone candidate has no second best: then the descriptor itself must be near.
    const float lone = a.real.empty() ? std::pow(static_cast<float>(a.length) * 8 * 0.2F, 2.0F) : 0.35F;
    for (auto& best : of_a) best.second = std::min(best.second, lone);
    return mutual(of_a, of_b, options.ratio);
  }
  const int na = std::min(options.most_unguided, static_cast<int>(a.pixels.size()));
  const int nb = std::min(options.most_unguided, static_cast<int>(b.pixels.size()));
  if (!a.real.empty()) {
    using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Map<const Rows> da(a.real.data(), na, a.length), db(b.real.data(), nb, b.length);
    const Rows similarity = da * db.transpose();
    for (int i = 0; i < na; ++i)
      for (int k = 0; k < nb; ++k) {
        const float d = 2 - 2 * similarity(i, k);
        of_a[static_cast<std::size_t>(i)].offer(d, k);
        of_b[static_cast<std::size_t>(k)].offer(d, i);
      }
  } else {
    for (int i = 0; i < na; ++i)
      for (int k = 0; k < nb; ++k) {
        const float d = distance2(a, i, b, k);
        of_a[static_cast<std::size_t>(i)].offer(d, k);
        of_b[static_cast<std::size_t>(k)].offer(d, i);
      }
  }
  return mutual(of_a, of_b, options.ratio - 0.03);
}

}  // namespace overfly::tiling::adjust
