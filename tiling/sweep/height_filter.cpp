#include "tiling/sweep/height_filter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace overfly::tiling {
namespace {

std::size_t at(int x, int y, int side) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(side) + static_cast<std::size_t>(x);
}

// Visits the 4-connected component of `start` among texels for which `joined(from, to)` holds.
template <typename Joined>
void growComponent(int start_x, int start_y, int side, std::vector<std::int32_t>& label, std::int32_t id,
                   std::vector<std::size_t>& members, const Joined& joined) {
  members.clear();
  members.push_back(at(start_x, start_y, side));
  label[members[0]] = id;
  for (std::size_t i = 0; i < members.size(); ++i) {
    const std::size_t here = members[i];
    const int x = static_cast<int>(here) % side, y = static_cast<int>(here) / side;
    const std::array<std::array<int, 2>, 4> next{{{x - 1, y}, {x + 1, y}, {x, y - 1}, {x, y + 1}}};
    for (const auto& [nx, ny] : next) {
      if (nx < 0 || ny < 0 || nx >= side || ny >= side) continue;
      const std::size_t there = at(nx, ny, side);
      if (label[there] != 0 || !joined(here, there)) continue;
      label[there] = id;
      members.push_back(there);
    }
  }
}

}  // namespace

std::vector<float> medianHeights(std::span<const float> height, int side, int radius) {
  std::vector<float> result(height.begin(), height.end());
  if (radius <= 0) return result;
  const cv::Mat source(side, side, CV_32F, const_cast<float*>(height.data()));
  cv::Mat target(side, side, CV_32F, result.data());
  cv::medianBlur(source, target, 2 * std::min(radius, 2) + 1);
  return result;
}

std::vector<float> smoothHeights(std::span<const float> height, std::span<const float> score, int side,
                                 double edge_m) {
  constexpr int kRadius = 2;
  std::vector<float> weight(score.size());
  for (std::size_t i = 0; i < score.size(); ++i) {
    const float s = std::max(0.02f, score[i]);
    weight[i] = s * s;
  }
  std::vector<float> result(height.begin(), height.end());
  const float inverse_edge = static_cast<float>(1.0 / edge_m);
  for (int y = kRadius; y < side - kRadius; ++y) {
    float* out = &result[at(0, y, side)];
    const float* centre = &height[at(0, y, side)];
    std::vector<float> sum(static_cast<std::size_t>(side), 0.0f), total(static_cast<std::size_t>(side), 0.0f);
    for (int dy = -kRadius; dy <= kRadius; ++dy)
      for (int dx = -kRadius; dx <= kRadius; ++dx) {
        const float* h = &height[at(0, y + dy, side)];
        const float* w = &weight[at(0, y + dy, side)];
        for (int x = kRadius; x < side - kRadius; ++x) {
          const float difference = (h[x + dx] - centre[x]) * inverse_edge;
          const float d2 = difference * difference;
          const float share = w[x + dx] / (1.0f + d2 * d2);
          sum[static_cast<std::size_t>(x)] += share * (h[x + dx] - centre[x]);
          total[static_cast<std::size_t>(x)] += share;
        }
      }
    for (int x = kRadius; x < side - kRadius; ++x)
      out[x] = centre[x] + sum[static_cast<std::size_t>(x)] / total[static_cast<std::size_t>(x)];
  }
  return result;
}

std::vector<float> upsampleHeights(std::span<const float> height, int texels, int apron) {
  const int coarse = texels + 2 * apron, fine = 2 * texels + 2 * apron;
  std::vector<float> result(static_cast<std::size_t>(fine) * static_cast<std::size_t>(fine));
  std::vector<int> index(static_cast<std::size_t>(fine));
  std::vector<float> share(static_cast<std::size_t>(fine));
  for (int i = 0; i < fine; ++i) {
    const double p = (i - apron + 0.5) / 2 + apron - 0.5;
    const int low = std::clamp(static_cast<int>(std::floor(p)), 0, coarse - 2);
    index[static_cast<std::size_t>(i)] = low;
    share[static_cast<std::size_t>(i)] = static_cast<float>(p - low);
  }
  for (int y = 0; y < fine; ++y) {
    const int iy = index[static_cast<std::size_t>(y)];
    const float fy = share[static_cast<std::size_t>(y)];
    for (int x = 0; x < fine; ++x) {
      const int ix = index[static_cast<std::size_t>(x)];
      const float fx = share[static_cast<std::size_t>(x)];
      const float top = (1 - fx) * height[at(ix, iy, coarse)] + fx * height[at(ix + 1, iy, coarse)];
      const float bottom =
          (1 - fx) * height[at(ix, iy + 1, coarse)] + fx * height[at(ix + 1, iy + 1, coarse)];
      result[at(x, y, fine)] = (1 - fy) * top + fy * bottom;
    }
  }
  return result;
}

HeightBounds upsampleBounds(std::span<const float> height, int texels, int apron) {
  const int coarse = texels + 2 * apron, fine = 2 * texels + 2 * apron;
  const cv::Mat source(coarse, coarse, CV_32F, const_cast<float*>(height.data()));
  cv::Mat low, high;
  const cv::Mat box = cv::Mat::ones(3, 3, CV_8U);
  cv::erode(source, low, box);
  cv::dilate(source, high, box);
  HeightBounds bounds;
  const std::size_t count = static_cast<std::size_t>(fine) * static_cast<std::size_t>(fine);
  bounds.low.resize(count);
  bounds.high.resize(count);
  for (int y = 0; y < fine; ++y)
    for (int x = 0; x < fine; ++x) {
      const int ix = std::clamp((x + apron) / 2, 0, coarse - 1),
                iy = std::clamp((y + apron) / 2, 0, coarse - 1);
      bounds.low[at(x, y, fine)] = low.at<float>(iy, ix);
      bounds.high[at(x, y, fine)] = high.at<float>(iy, ix);
    }
  return bounds;
}

std::vector<float> ceilingOf(std::span<const float> height, int side) {
  const cv::Mat source(side, side, CV_32F, const_cast<float*>(height.data()));
  cv::Mat highest;
  cv::dilate(source, highest, cv::Mat::ones(2 * kCeilingBlock, 2 * kCeilingBlock, CV_8U),
             {kCeilingBlock / 2, kCeilingBlock / 2});
  const int blocks = (side + kCeilingBlock - 1) / kCeilingBlock;
  std::vector<float> ceiling;
  for (int y = 0; y < blocks; ++y)
    for (int x = 0; x < blocks; ++x)
      ceiling.push_back(highest.at<float>(y * kCeilingBlock, x * kCeilingBlock));
  return ceiling;
}

std::vector<float> highestAround(std::span<const float> height, int side, int radius) {
  const cv::Mat source(side, side, CV_32F, const_cast<float*>(height.data()));
  std::vector<float> highest(height.size());
  cv::dilate(source, cv::Mat(side, side, CV_32F, highest.data()),
             cv::Mat::ones(2 * radius + 1, 2 * radius + 1, CV_8U));
  return highest;
}

void removeIslands(std::span<float> height, int side, double max_step_m, int min_texels) {
  if (min_texels <= 1) return;
  std::vector<std::int32_t> label(height.size(), 0);
  std::vector<std::size_t> members;
  std::vector<std::size_t> doomed;
  std::int32_t id = 0;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      if (label[at(x, y, side)] != 0 || std::isnan(height[at(x, y, side)])) continue;
      growComponent(x, y, side, label, ++id, members, [&](std::size_t from, std::size_t to) {
        return std::abs(height[to] - height[from]) <= max_step_m;
      });
      if (static_cast<int>(members.size()) < min_texels)
        doomed.insert(doomed.end(), members.begin(), members.end());
    }
  for (const std::size_t i : doomed) height[i] = std::numeric_limits<float>::quiet_NaN();
}

namespace {

// The largest surface below `mask` that `marker` (nowhere above it) can rise to along 8-connected texels, in
// place: two scans, then a queue for what they leave (Vincent's hybrid algorithm). Both have a rim of one
// texel that is as low as can be.
void reconstruct(cv::Mat_<float>& marker, const cv::Mat_<float>& mask) {
  const int side = mask.cols;
  const auto n = static_cast<std::ptrdiff_t>(side);
  float* const m = marker[0];
  const float* const most = mask[0];
  for (int y = 1; y < side - 1; ++y)
    for (std::ptrdiff_t i = y * n + 1; i < (y + 1) * n - 1; ++i) {
      const float before = std::max(std::max(m[i - n - 1], m[i - n]), std::max(m[i - n + 1], m[i - 1]));
      m[i] = std::min(std::max(m[i], before), most[i]);
    }
  std::vector<std::ptrdiff_t> queue;
  for (int y = side - 2; y > 0; --y)
    for (std::ptrdiff_t i = (y + 1) * n - 2; i > y * n; --i) {
      const std::ptrdiff_t after[4] = {i + 1, i + n - 1, i + n, i + n + 1};
      float best = m[i];
      for (const std::ptrdiff_t k : after) best = std::max(best, m[k]);
      m[i] = std::min(best, most[i]);
      for (const std::ptrdiff_t k : after)
        if (m[k] < m[i] && m[k] < most[k]) {
          queue.push_back(i);
          break;
        }
    }
  for (std::size_t head = 0; head < queue.size(); ++head) {
    const std::ptrdiff_t i = queue[head];
    for (const std::ptrdiff_t k : {i - n - 1, i - n, i - n + 1, i - 1, i + 1, i + n - 1, i + n, i + n + 1}) {
      const float up_to = std::min(m[i], most[k]);
      if (m[k] >= up_to) continue;
      m[k] = up_to;
      queue.push_back(k);
    }
  }
}

}  // namespace

void removeNeedles(std::span<float> height, std::span<const float> closed, int side, double texel_m) {
  constexpr float kUnknown = std::numeric_limits<float>::max();
  constexpr int kWidths[] = {9, 17, 33, 65};  // texels
  constexpr int kAround = 129;
  constexpr double kAspect = 5, kLeast = 60;  // times the width; texels
  const auto most = [&](int width) {
    return static_cast<float>(std::max(kLeast, kAspect * width) * texel_m);
  };
  const cv::Mat_<float> field(side, side, const_cast<float*>(closed.data()));
  cv::Mat_<float> known = field.clone(), mask = field.clone();
  for (int i = 0; i < side * side; ++i)
    if (std::isnan(field(i))) {
      known(i) = kUnknown;
      mask(i) = -kUnknown;
    }
  cv::Mat_<float> ground;  // the lowest around, where holes let no square fit
  cv::erode(known, ground, cv::Mat::ones(kAround, kAround, CV_8U));
  const auto padded = [](const cv::Mat_<float>& inner) {
    cv::Mat_<float> out;
    cv::copyMakeBorder(inner, out, 1, 1, 1, 1, cv::BORDER_CONSTANT, cv::Scalar(-kUnknown));
    return out;
  };
  const auto stands = [&](int i, float kept, float above) {
    return mask(i) != -kUnknown && mask(i) - std::max(kept, ground(i)) > above;
  };
  std::vector<int> high, needles;  // what may be one; what is
  for (int i = 0; i < side * side; ++i)
    if (stands(i, -kUnknown, most(0))) high.push_back(i);
  const cv::Mat_<float> rimmed = padded(mask);
  for (const int width : kWidths) {
    std::erase_if(high, [&](int i) { return !stands(i, -kUnknown, most(width)); });
    if (high.empty()) break;
    cv::Mat_<float> kept;
    cv::erode(mask, kept, cv::Mat::ones(width, width, CV_8U));
    if (std::ranges::none_of(high, [&](int i) { return stands(i, kept(i), most(width)); })) continue;
    cv::min(cv::InputArray(kept), mask, kept);  // beside the field's border anything may stand
    cv::Mat_<float> risen = padded(kept);
    reconstruct(risen, rimmed);
    for (const int i : high)
      if (stands(i, risen(i / side + 1, i % side + 1), most(width))) needles.push_back(i);
  }
  for (const int i : needles) height[static_cast<std::size_t>(i)] = std::numeric_limits<float>::quiet_NaN();
}

void fillHoles(std::span<float> height, std::span<std::uint8_t> filled, int side, int max_texels,
               double step_m) {
  const std::vector<float> source(height.begin(), height.end());
  std::vector<std::int32_t> label(height.size(), 0);
  std::vector<std::size_t> members;
  std::int32_t id = 0;
  constexpr std::array<std::array<int, 2>, 8> kDirections{
      {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, -1}, {1, -1}, {-1, 1}}};
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      if (label[at(x, y, side)] != 0 || !std::isnan(source[at(x, y, side)])) continue;
      growComponent(x, y, side, label, ++id, members,
                    [&](std::size_t, std::size_t to) { return std::isnan(source[to]); });
      if (static_cast<int>(members.size()) > max_texels) continue;
      const bool at_border = std::any_of(members.begin(), members.end(), [&](std::size_t i) {
        const int mx = static_cast<int>(i) % side, my = static_cast<int>(i) / side;
        return mx == 0 || my == 0 || mx == side - 1 || my == side - 1;
      });
      if (at_border) continue;
      for (const std::size_t i : members) {
        const int mx = static_cast<int>(i) % side, my = static_cast<int>(i) / side;
        std::array<float, 8> found{}, distance{};
        int count = 0;
        float lowest = std::numeric_limits<float>::infinity();
        for (const auto& [dx, dy] : kDirections) {
          int px = mx, py = my;
          float steps = 0;
          while (px >= 0 && py >= 0 && px < side && py < side && std::isnan(source[at(px, py, side)])) {
            px += dx;
            py += dy;
            steps += dx != 0 && dy != 0 ? 1.41421356f : 1.0f;
          }
          if (px < 0 || py < 0 || px >= side || py >= side) continue;
          found[static_cast<std::size_t>(count)] = source[at(px, py, side)];
          distance[static_cast<std::size_t>(count)] = steps;
          lowest = std::min(lowest, source[at(px, py, side)]);
          ++count;
        }
        float sum = 0, total = 0;
        for (int k = 0; k < count; ++k) {
          const auto n = static_cast<std::size_t>(k);
          if (found[n] > lowest + static_cast<float>(step_m)) continue;
          sum += found[n] / distance[n];
          total += 1 / distance[n];
        }
        if (total > 0) {
          height[i] = sum / total;
          filled[i] = 1;
        }
      }
    }
}

}  // namespace overfly::tiling
