// The sweep and the orthophoto on scenes in closed form, against their truth.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/sweep/gpu_photos.h"
#include "tests/unit/sweep/shifts.h"
#include "tiling/mapping/guess_surface.h"
#include "tiling/sweep/height_filter.h"

namespace overfly::tiling {
namespace {

using test::kFlight;
using test::kGround;
using test::kGsd;

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::nan("");
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(std::min(static_cast<double>(values.size() - 1),
                                                            q * static_cast<double>(values.size())));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Mean distance of two cameras, over which the height of flight counts.
double heightPerBaseline(const std::vector<SweepView>& views) {
  double sum = 0;
  int pairs = 0;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = 0; j < i; ++j, ++pairs)
      sum += (views[i].pose.position_in_ecef - views[j].pose.position_in_ecef).norm();
  return kFlight / (sum / pairs);
}

struct Swept {
  test::Scene scene;
  test::GpuPhotos photos;
  HeightField field;

  [[nodiscard]] Eigen::Vector2d place(int x, int y) const {
    return test::placeOf(x, y, field.texels, field.apron);
  }
  // Calls for every texel of the cell (without apron): x, y, height, truth.
  template <typename Visit>
  void forCell(const Visit& visit) const {
    for (int y = field.apron; y < field.apron + field.texels; ++y)
      for (int x = field.apron; x < field.apron + field.texels; ++x) {
        const Eigen::Vector2d p = place(x, y);
        visit(x, y, static_cast<double>(field.height[static_cast<std::size_t>(y * field.side() + x)]),
              scene.height(p.x(), p.y()));
      }
  }
};

class AnalyticScene : public test::GlTest {
 protected:
  static Swept sweep(const test::Scene& scene, double tilt, const SweepOptions& options = {}) {
    Swept swept{scene, test::GpuPhotos(context(), test::takeNine(scene, tilt)), {}};
    auto sweeper = Sweeper::create(context());
    if (!sweeper) throw std::runtime_error(sweeper.error().message);
    auto field = (*sweeper)->run(test::sceneGrid(), swept.photos.sweepViews(), options);
    if (!field) throw std::runtime_error(field.error().message);
    swept.field = std::move(*field);
    return swept;
  }

  // Completeness and errors on smooth ground; asserts the bar of 0.25 GSD x height / baseline.
  static void expectSmoothGround(const Swept& swept, const char* name) {
    double squares = 0, sum = 0;
    std::vector<double> absolute;
    std::size_t texels = 0;
    swept.forCell([&](int, int, double height, double truth) {
      ++texels;
      if (std::isnan(height)) return;
      squares += (height - truth) * (height - truth);
      sum += height - truth;
      absolute.push_back(std::abs(height - truth));
    });
    const auto n = static_cast<double>(absolute.size());
    const double rmse = std::sqrt(squares / n);
    const double bar = 0.25 * kGsd * heightPerBaseline(swept.photos.sweepViews());
    RecordProperty("rmse_m", std::to_string(rmse));
    std::printf("%s: complete %.4f, RMSE %.4f m (bar %.4f), mean %.4f, p99 %.4f, worst %.3f\n", name,
                n / static_cast<double>(texels), rmse, bar, sum / n, quantile(absolute, 0.99),
                quantile(absolute, 1.0));
    EXPECT_GE(n / static_cast<double>(texels), 0.99);
    EXPECT_LE(rmse, bar);
    EXPECT_LE(std::abs(sum / n), 0.1 * bar);  // no bias
  }

  static Orthophoto colour(const Swept& swept, const std::vector<float>& height, int size) {
    auto orthographer = Orthographer::create(context());
    if (!orthographer) throw std::runtime_error(orthographer.error().message);
    const std::vector<std::uint8_t> provisional(height.size(), 0);
    auto photo =
        (*orthographer)
            ->render({&test::sceneFrame(), swept.field.texels, swept.field.apron, height, provisional},
                     swept.photos.orthoViews(), size);
    if (!photo) throw std::runtime_error(photo.error().message);
    return std::move(*photo);
  }
};

test::Scene ramp() {
  return {[](double east, double north) { return kGround + 0.15 * east - 0.1 * north; }, {}};
}
test::Scene hills() {
  return {[](double east, double north) {
            return kGround + 0.8 * std::sin(0.45 * east) * std::cos(0.35 * north + 0.4);
          },
          {}};
}
test::Scene boxOnGround() {
  test::Scene scene{[](double, double) { return kGround; }, {}};
  scene.box = test::Box{-5.03, -4.98, 5.03, 5.06, kGround + 10};
  return scene;
}

TEST_F(AnalyticScene, PlaneStraightDown) {
  expectSmoothGround(sweep({[](double, double) { return kGround; }, {}}, 0), "plane");
}
TEST_F(AnalyticScene, RampTilted) { expectSmoothGround(sweep(ramp(), 0.05), "ramp"); }

TEST_F(AnalyticScene, HillsTiltedAndNeitherHeightNorColourIsShifted) {
  const Swept swept = sweep(hills(), 0.05);
  expectSmoothGround(swept, "hills");
  const int texels = swept.field.texels, apron = swept.field.apron, side = swept.field.side();
  const auto placeAt = [&](double x, double y) -> Eigen::Vector2d {
    return test::sceneFrame().enuFromTexel((x + 0.5) / texels, (y + 0.5) / texels, kGround).head<2>();
  };
  // A block counts only where it is whole: the few texels without a height (0.01 %) are filled.
  const std::vector<float> whole = guessSurface(swept.field.height, side, 2 * kGsd, kGround);
  std::vector<double> height;
  for (int y = 0; y < texels; ++y)
    for (int x = 0; x < texels; ++x)
      height.push_back(static_cast<double>(whole[static_cast<std::size_t>((y + apron) * side + x + apron)]) -
                       kGround);
  const std::vector<double> height_shifts = test::shiftsOf(height, texels, texels, [&](double x, double y) {
    const Eigen::Vector2d p = placeAt(x, y);
    return swept.scene.ground(p.x(), p.y()) - kGround;
  });
  // One figure for the whole cell: hills as long as these tell nothing finer.
  ASSERT_EQ(height_shifts.size(), 1u);
  std::printf("hills: heights are shifted by %.3f texel\n", height_shifts[0]);
  EXPECT_LE(height_shifts[0], 0.1);

  const Orthophoto photo = colour(swept, whole, texels);
  std::vector<double> luma;
  for (std::size_t i = 0; i < photo.source.size(); ++i) {
    EXPECT_EQ(photo.color[4 * i + 3], 255);
    luma.push_back(photo.color[4 * i] / 255.0);
  }
  const std::vector<double> shifts = test::shiftsOf(luma, texels, 32, [&](double x, double y) {
    const Eigen::Vector2d p = placeAt(x, y);
    return swept.scene.pattern.at(p.x(), p.y());
  });
  std::printf("hills: shift of colour median %.3f, p95 %.3f texel of %zu blocks\n", quantile(shifts, 0.5),
              quantile(shifts, 0.95), shifts.size());
  EXPECT_GE(shifts.size(), 60u);
  EXPECT_LE(quantile(shifts, 0.5), 0.1);
  EXPECT_LE(quantile(shifts, 0.95), 0.3);
}

TEST_F(AnalyticScene, BoxHasItsRoofItsEdgesAndNoWallOnTheGround) {
  const Swept swept = sweep(boxOnGround(), 0.03);
  const test::Box& box = *swept.scene.box;
  const int side = swept.field.side();
  const auto distanceToEdge = [&](const Eigen::Vector2d& p) {  // texels; positive inside
    return std::min({p.x() - box.west, box.east - p.x(), p.y() - box.south, box.north - p.y()}) / kGsd;
  };
  std::vector<double> roof, ground, edges;
  std::size_t ground_texels = 0, roof_texels = 0;
  swept.forCell([&](int x, int y, double height, double truth) {
    const double inside = distanceToEdge(swept.place(x, y));
    if (inside > 3) {
      ++roof_texels;
      if (!std::isnan(height)) roof.push_back(height - truth);
    } else if (inside < -3) {
      ++ground_texels;
      if (!std::isnan(height)) ground.push_back(height - truth);
    }
    // Where a texel is on the wrong side of half the height, by how far is it from the true edge?
    if (!std::isnan(height) && (height > kGround + 5) != (truth > kGround + 5))
      edges.push_back(std::abs(inside));
  });
  const double scale = kGsd * heightPerBaseline(swept.photos.sweepViews());
  std::vector<double> roof_error;
  for (const double e : roof) roof_error.push_back(std::abs(e));
  std::size_t bad_ground = 0;
  for (const double e : ground) bad_ground += std::abs(e) > 1 ? 1 : 0;
  const double far_edges =
      static_cast<double>(std::count_if(edges.begin(), edges.end(), [](double d) { return d > 2; }));
  const double perimeter_texels = 2 * (box.east - box.west + box.north - box.south) / kGsd;
  std::printf(
      "box: roof complete %.4f median %.4f m p99 %.4f m (GSD x h/b %.3f m); ground complete %.4f, "
      "beyond 1 m %.5f\n",
      static_cast<double>(roof.size()) / static_cast<double>(roof_texels), quantile(roof, 0.5),
      quantile(roof_error, 0.99), scale,
      static_cast<double>(ground.size()) / static_cast<double>(ground_texels),
      static_cast<double>(bad_ground) / static_cast<double>(ground.size()));
  std::printf(
      "box: edge texels on the wrong side %zu, median %.2f p95 %.2f worst %.2f texels; beyond two "
      "texels %.3f per texel of perimeter\n",
      edges.size(), quantile(edges, 0.5), quantile(edges, 0.95), quantile(edges, 1),
      far_edges / perimeter_texels);
  EXPECT_GE(static_cast<double>(roof.size()) / static_cast<double>(roof_texels), 0.99);
  EXPECT_LE(std::abs(quantile(roof, 0.5)), 0.25 * kGsd);
  EXPECT_LE(quantile(roof_error, 0.99), kGsd);
  EXPECT_GE(static_cast<double>(ground.size()) / static_cast<double>(ground_texels), 0.95);
  EXPECT_LE(static_cast<double>(bad_ground), 0.002 * static_cast<double>(ground.size()));
  // Edges stand within two texels.
  EXPECT_LE(quantile(edges, 0.5), 1);
  EXPECT_LE(quantile(edges, 1), 2.5);
  EXPECT_LE(far_edges, 0.02 * perimeter_texels);

  // Colour, on the true surface and on the swept one: magenta is the walls'.
  const auto walls = [&](const std::vector<float>& height) {  // distances to the box, texels
    const Orthophoto photo = colour(swept, height, swept.field.texels);
    std::vector<double> distance;
    swept.forCell([&](int x, int y, double, double) {
      const double outside = -distanceToEdge(swept.place(x, y));
      const auto at =
          4 * static_cast<std::size_t>((y - swept.field.apron) * swept.field.texels + x - swept.field.apron);
      const int excess = std::min(photo.color[at], photo.color[at + 2]) - photo.color[at + 1];
      if (outside > 0 && excess > 40) distance.push_back(outside);
    });
    return distance;
  };
  const auto beyond = [](const std::vector<double>& distance, double limit) {
    return static_cast<double>(
        std::count_if(distance.begin(), distance.end(), [&](double d) { return d > limit; }));
  };
  std::vector<float> truth;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const Eigen::Vector2d p = swept.place(x, y);
      truth.push_back(static_cast<float>(swept.scene.height(p.x(), p.y())));
    }
  std::vector<float> filled = swept.field.height;
  std::vector<std::uint8_t> marks(filled.size(), 0);
  fillHoles(filled, marks, side, 400, 3 * swept.field.plane_step_m);
  const std::vector<float> surface = guessSurface(filled, side, 2 * kGsd, kGround);
  const std::vector<double> on_truth = walls(truth), on_swept = walls(surface);
  std::printf(
      "box: wall-coloured ground texels beyond two texels: %.0f on the true surface (farthest %.2f), %.0f on "
      "the swept (farthest %.2f)\n",
      beyond(on_truth, 2), quantile(on_truth, 1), beyond(on_swept, 2), quantile(on_swept, 1));
  EXPECT_EQ(beyond(on_truth, 1), 0);
  // What remains are single texels whose height is neither the ground's nor the roof's.
  EXPECT_LE(beyond(on_swept, 2), 0.0001 * static_cast<double>(ground_texels));
}

}  // namespace
}  // namespace overfly::tiling
