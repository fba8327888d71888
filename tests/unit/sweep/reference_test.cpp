// The GPU's kernels against plain double code on the CPU.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/sweep/gpu_photos.h"

namespace overfly::tiling {
namespace {

using test::kFlight;
using test::kGround;

struct Grey {
  int width, height;
  std::vector<std::uint8_t> value;

  // Bilinear, clamped at the border, 0..1; texture coordinates.
  [[nodiscard]] double at(double u, double v) const {
    const double x = u * width - 0.5, y = v * height - 0.5;
    const double ix = std::floor(x), iy = std::floor(y), fx = x - ix, fy = y - iy;
    const auto pixel = [&](int dx, int dy) {
      const int px = std::clamp(static_cast<int>(ix) + dx, 0, width - 1);
      const int py = std::clamp(static_cast<int>(iy) + dy, 0, height - 1);
      return value[static_cast<std::size_t>(py * width + px)] / 255.0;
    };
    return (1 - fy) * ((1 - fx) * pixel(0, 0) + fx * pixel(1, 0)) +
           fy * ((1 - fx) * pixel(0, 1) + fx * pixel(1, 1));
  }
};

Grey download(const gl::Texture& texture) {
  Grey grey{texture.width(), texture.height(), {}};
  grey.value.resize(static_cast<std::size_t>(grey.width * grey.height));
  if (auto ok = texture.download(std::span<std::uint8_t>(grey.value)); !ok)
    throw std::runtime_error(ok.error().message);
  return grey;
}

struct Reference {
  std::vector<double> height, score;
};

// Every plane at every texel: agreement of all pairs that see the point, mean over the window, best plane,
// parabola through it and its neighbours.
Reference sweepReference(const SweepGrid& grid, const std::vector<SweepView>& views, MatchCost cost,
                         int radius, double step, int planes) {
  const int side = grid.texels + 2 * grid.apron;
  const auto texels = static_cast<std::size_t>(side * side);
  std::vector<Grey> images;
  for (const SweepView& view : views) images.push_back(download(*view.match));
  std::vector<std::vector<double>> agreement(static_cast<std::size_t>(planes), std::vector<double>(texels));
  for (int plane = 0; plane < planes; ++plane)
    for (int y = 0; y < side; ++y)
      for (int x = 0; x < side; ++x) {
        const Eigen::Vector3d point = grid.frame->local().ecefFromEnu(grid.frame->enuFromTexelExact(
            (x - grid.apron + 0.5) / grid.texels, (y - grid.apron + 0.5) / grid.texels,
            grid.min_height_m + plane * step));
        std::vector<double> seen;
        for (std::size_t k = 0; k < views.size(); ++k) {
          const Eigen::Vector3d in_camera =
              views[k].pose.ecef_from_camera.conjugate() * (point - views[k].pose.position_in_ecef);
          const auto pixel = views[k].camera.project(in_camera);
          if (!pixel) continue;
          const double u = pixel->x() / views[k].camera.width, v = pixel->y() / views[k].camera.height;
          if (!(u > 0 && u < 1 && v > 0 && v < 1)) continue;
          const double value = images[k].at(u, v);
          if (value > 0.002) seen.push_back(value - 128.0 / 255);
        }
        double sum = 0;
        int pairs = 0;
        for (std::size_t i = 0; i < seen.size(); ++i)
          for (std::size_t j = 0; j < i; ++j, ++pairs) {
            const double d = seen[i] - seen[j];
            sum += cost == MatchCost::Zncc  ? seen[i] * seen[j]
                   : cost == MatchCost::Sad ? -std::abs(d)
                                            : -d * d;
          }
        agreement[static_cast<std::size_t>(plane)][static_cast<std::size_t>(y * side + x)] =
            pairs > 0 ? sum / pairs : (cost == MatchCost::Zncc ? -0.02 : -1.0);
      }
  const auto windowed = [&](int plane, int x, int y) {
    double sum = 0;
    for (int dy = -radius; dy <= radius; ++dy)
      for (int dx = -radius; dx <= radius; ++dx)
        sum += agreement[static_cast<std::size_t>(plane)][static_cast<std::size_t>(
            std::clamp(y + dy, 0, side - 1) * side + std::clamp(x + dx, 0, side - 1))];
    return sum / ((2 * radius + 1) * (2 * radius + 1));
  };
  Reference reference;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      std::vector<double> score;
      for (int plane = 0; plane < planes; ++plane) score.push_back(windowed(plane, x, y));
      const auto best =
          static_cast<std::size_t>(std::max_element(score.begin(), score.end()) - score.begin());
      double offset = 0;
      if (best > 0 && best + 1 < score.size()) {
        const double curvature = score[best - 1] - 2 * score[best] + score[best + 1];
        if (curvature < 0)
          offset = std::clamp(0.5 * (score[best - 1] - score[best + 1]) / curvature, -0.5, 0.5);
      }
      reference.height.push_back(grid.min_height_m + step * (static_cast<double>(best) + offset));
      reference.score.push_back(score[best]);
    }
  return reference;
}

class CpuReference : public test::GlTest {};

TEST_F(CpuReference, MatchImageIsTheLocallyNormalisedLuminance) {
  const test::Scene scene{[](double, double) { return kGround; }, {}, test::Pattern(3, 0.5)};
  test::Photo photo =
      test::takePhoto(scene, test::sceneCamera(90, 90), test::lookDown(1, 2, kGround + kFlight));
  for (std::size_t i = 0; i < 500; ++i) photo.rgba[4 * i + 3] = 0;  // not valid
  const test::GpuPhotos gpu(context(), {photo});
  const Grey match = download(*gpu.sweepViews()[0].match);
  const MatchImageOptions options;
  int far = 0;
  for (int y = 0; y < 90; ++y)
    for (int x = 0; x < 90; ++x) {
      const auto luma = [&](int px, int py) {
        return static_cast<double>(
            photo.luma[static_cast<std::size_t>(std::clamp(py, 0, 89) * 90 + std::clamp(px, 0, 89))]);
      };
      double sum = 0, squares = 0;
      for (int dy = -options.radius; dy <= options.radius; ++dy)
        for (int dx = -options.radius; dx <= options.radius; ++dx) {
          sum += luma(x + dx, y + dy);
          squares += luma(x + dx, y + dy) * luma(x + dx, y + dy);
        }
      const double n = (2 * options.radius + 1) * (2 * options.radius + 1), mean = sum / n;
      const double deviation = std::sqrt(squares / n - mean * mean + options.noise * options.noise);
      const auto i = static_cast<std::size_t>(y * 90 + x);
      const double code = i < 500 ? 0 : std::clamp(128 + 42 * (luma(x, y) - mean) / deviation, 1.0, 255.0);
      far += std::abs(match.value[i] - code) > 1.0 ? 1 : 0;
    }
  EXPECT_LE(far, 8);  // 0.1 %
}

TEST_F(CpuReference, PlanesWindowAndParabolaAgreeWithinAQuarterStep) {
  const auto seed = static_cast<std::uint32_t>(
      std::getenv("OVERFLY_SEED") != nullptr ? std::atoi(std::getenv("OVERFLY_SEED")) : 20);
  std::mt19937 random(seed);
  SCOPED_TRACE("OVERFLY_SEED=" + std::to_string(seed));
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  auto sweeper = Sweeper::create(context());
  ASSERT_TRUE(sweeper.has_value()) << sweeper.error().message;
  for (int round = 0; round < 9; ++round) {
    const auto cost = static_cast<MatchCost>(round % 3);
    const double slope_east = uniform(-0.2, 0.2), slope_north = uniform(-0.2, 0.2);
    const test::Scene scene{
        [&](double east, double north) { return kGround + slope_east * east + slope_north * north; },
        {},
        test::Pattern(seed + static_cast<std::uint32_t>(round), 1.6)};
    std::vector<test::Photo> photos;
    const int count = 2 + round % 5;
    for (int i = 0; i < count; ++i)
      photos.push_back(test::takePhoto(
          scene, test::sceneCamera(80, 75),
          test::lookDown(12.0 * (i % 2) - 6 + uniform(-2, 2), 10.0 * (i / 2) - 8 + uniform(-2, 2),
                         kGround + kFlight + uniform(-3, 3), uniform(-0.08, 0.08), uniform(-0.08, 0.08))));
    const test::GpuPhotos gpu(context(), photos);
    const SweepGrid grid{&test::sceneFrame(), 32, 4, kGround, kGround - 10, kGround + 12 + uniform(0, 5)};
    SweepOptions options;
    options.cost = cost;
    options.levels = 1;
    options.window_radius = 1 + round / 3;
    options.min_score = -10;
    options.median_radius = 0;
    options.smooth_planes = 0;
    options.min_segment = 1;
    const std::vector<SweepView> views = gpu.sweepViews(cost != MatchCost::Zncc);
    const auto field = (*sweeper)->run(grid, views, options);
    ASSERT_TRUE(field.has_value()) << field.error().message;
    const double step = field->plane_step_m;
    // The GPU works on seven planes at a time, two of them shared with the next seven, until the range is
    // done.
    const int needed = static_cast<int>(std::ceil((grid.max_height_m - grid.min_height_m) / step)) + 1;
    const int planes = 5 * std::max(1, (needed - 2 + 4) / 5) + 2;
    const Reference reference = sweepReference(grid, views, cost, options.window_radius, step, planes);
    std::size_t agree = 0;
    for (std::size_t i = 0; i < reference.height.size(); ++i)
      agree += std::abs(static_cast<double>(field->height[i]) - reference.height[i]) <= step / 4 ? 1 : 0;
    const double share = static_cast<double>(agree) / static_cast<double>(reference.height.size());
    std::printf("round %d: cost %d, %d views, window %d, %d planes: %.4f within a quarter step\n", round,
                static_cast<int>(cost), count, options.window_radius, planes, share);
    EXPECT_GE(share, 0.99);
  }
}

}  // namespace
}  // namespace overfly::tiling
