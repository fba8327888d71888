#include "render/scene/renderer.h"

#include <gtest/gtest.h>

#include "tests/unit/scene/scene_fixture.h"

namespace overfly::scene {
namespace {

const std::string kHamlet = R"(
[terrain]
kind = "fractal"
extent = [140, 120]
relief = 2
[[street]]
points = [[-60, -10], [60, 8]]
[[building]]
kind = "gable"
at = [6, 12]
size = [14, 9]
turn_deg = 20
[[building]]
at = [-16, 14]
size = [8, 8]
height = 12
[path]
height = 45
frames = 4
lines = 1
sway_deg = 3
drift = 2
)" + kSmallCamera;

TEST(Renderer, AgreesWithTheRayTracer) {
  for (const std::string effects :
       {"effects = []\n", "effects = [\"sun_shadows\"]\n[effect.sun_shadows]\nmap_size = 4096\n"}) {
    Stage stage(effects + kHamlet);
    const Geometry geometry(*stage.world);
    TraceOptions options;
    options.shadows = findEffect(stage.world->description.effects, Effect::SunShadows) != nullptr;
    for (const int frame : {0, 2}) {
      const FlightPath& path = stage.renderer->path();
      const Picture traced =
          tracePicture(geometry, stage.renderer->camera(), path, path.timeOf(frame), options);
      EXPECT_GT(agreement(stage.render(frame), traced, 2), 0.95) << effects << frame;
    }
  }
}

TEST(Renderer, ObliqueViewsAgreeToo) {
  Stage stage(kHamlet);
  const Geometry geometry(*stage.world);
  CameraState state = lookingDown(10, -45, 30);
  state.enu_from_camera = Eigen::AngleAxisd(0.9, Eigen::Vector3d::UnitX()) * state.enu_from_camera;
  EXPECT_GT(agreement(stage.render(state), tracePicture(geometry, stage.renderer->camera(), state), 2), 0.93);
}

TEST(Renderer, PlantsAgreeToo) {
  Stage stage("[[vegetation]]\nper_hectare = 150\n" + kHamlet);
  ASSERT_GT(stage.world->plants.size(), 50u);
  const Geometry geometry(*stage.world);
  const FlightPath& path = stage.renderer->path();
  const Picture traced = tracePicture(geometry, stage.renderer->camera(), path, path.timeOf(1));
  EXPECT_GT(agreement(stage.render(1), traced, 6), 0.9);
}

TEST(Renderer, FramesAreTheSameBytesOnEveryRun) {
  Stage one("[[vegetation]]\nper_hectare = 150\n" + kHamlet),
      two("[[vegetation]]\nper_hectare = 150\n" + kHamlet);
  const Picture first = one.render(3);
  one.render(1);
  EXPECT_EQ(first.rgb, one.render(3).rgb);
  EXPECT_EQ(first.rgb, two.render(3).rgb);
}

TEST(Renderer, NoEffectMeansOneGeometryPassAndNothingElse) {
  Stage stage(kHamlet);
  stage.render();
  ASSERT_EQ(stage.renderer->lastCost().passes.size(), 1u);
  EXPECT_EQ(stage.renderer->lastCost().passes[0].name, "geometry");
  const std::vector<GraphNode> graph = compileGraph({});
  ASSERT_EQ(graph.size(), 1u);
  EXPECT_EQ(graph[0].kind, GraphNode::Kind::Geometry);
}

TEST(Renderer, NamingAnEffectAddsExactlyItsOwnPasses) {
  for (const EffectInfo& info : allEffects()) {
    Stage stage("effects = [\"" + std::string(info.name) + "\"]\n" + kHamlet);
    stage.render();
    std::vector<std::string> names;
    for (const FrameCost::Pass& pass : stage.renderer->lastCost().passes) names.push_back(pass.name);
    switch (kindOf(info.effect)) {
      case GraphNode::Kind::Pass:
        EXPECT_EQ(names, (std::vector<std::string>{"geometry", std::string(info.name)}));
        break;
      case GraphNode::Kind::Target:
        EXPECT_EQ(names, (std::vector<std::string>{std::string(info.name), "geometry"}));
        break;
      default:
        EXPECT_EQ(names, std::vector<std::string>{"geometry"}) << info.name;
    }
    EXPECT_EQ(compileGraph(stage.world->description.effects).size(), 2u) << info.name;
  }
}

TEST(Renderer, EffectsOnPoseAndStreamLeaveThePictureAlone) {
  const Picture bare = Stage(kHamlet).render(2);
  for (const char* name : {"gnss_noise", "attitude_noise", "mounting", "time_delay", "dropped_poses",
                           "dropped_frames", "jpeg"}) {
    EXPECT_EQ(Stage("effects = [\"" + std::string(name) + "\"]\n" + kHamlet).render(2).rgb, bare.rgb) << name;
  }
}

// Corners of boxes, found in the picture to a fraction of a pixel, against the projection in double.
TEST(Renderer, CornersOfBoxesStandWhereTheyProject) {
  Stage stage(
      "base = \"water\"\n[[building]]\nat = [-9, 4]\nsize = [10, 7]\nturn_deg = 17\nheight = 9\nwall = "
      "\"rock\"\nroof = \"concrete\"\n"
      "[[building]]\nat = [10, -5]\nsize = [6, 9]\nturn_deg = -33\nheight = 4\nroof = "
      "\"concrete\"\n[camera]\nwidth = 800\nheight = 600\nfx = 700\n");
  const CameraState state = lookingDown(1, 0.5, 40);
  stage.render(state);
  const std::vector<float> depth = *stage.renderer->depth();
  const capture::CameraModel& camera = stage.renderer->camera();
  int corners = 0;
  for (const BuildingDescription& box : stage.world->description.buildings) {
    const double top = 40 - box.height;
    const auto isTop = [&](int x, int y) {
      return std::abs(depth[static_cast<std::size_t>(y * camera.width + x)] - top) < 0.02;
    };
    // Each edge of the roof as a line through where the rows (or columns) change from roof to not roof; the
    // edge's place between two pixel centres is half-way, on average over many rows.
    std::vector<Eigen::Vector2d> exact;
    for (const auto& [sx, sy] : {std::pair(-1, -1), std::pair(1, -1), std::pair(1, 1), std::pair(-1, 1)}) {
      const Eigen::Vector2d p =
          box.at +
          Eigen::Rotation2Dd(box.turn) * Eigen::Vector2d(0.5 * sx * box.size.x(), 0.5 * sy * box.size.y());
      exact.push_back(*camera.project(state.cameraFromEnu({p.x(), p.y(), box.height})));
    }
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector2d a = exact[i], b = exact[(i + 1) % 4];
      const bool steep = std::abs(b.y() - a.y()) > std::abs(b.x() - a.x());
      const auto main_axis = static_cast<Eigen::Index>(steep ? 1 : 0),
                 other = static_cast<Eigen::Index>(steep ? 0 : 1);
      const int from = static_cast<int>(std::min(a[main_axis], b[main_axis])) + 4,
                to = static_cast<int>(std::max(a[main_axis], b[main_axis])) - 4;
      double error = 0;
      for (int s = from; s < to; ++s) {
        const double expected =
            a[other] + (s + 0.5 - a[main_axis]) / (b[main_axis] - a[main_axis]) * (b[other] - a[other]);
        const int around = static_cast<int>(expected);
        const auto inside = [&](int o) { return steep ? isTop(o, s) : isTop(s, o); };
        int edge = around - 3;
        while (edge < around + 3 && inside(edge) == inside(around - 3)) ++edge;
        error += edge - expected;  // the change lies between the centres at edge - 0.5 and edge + 0.5
      }
      // The first of the four samples, which depth() reads, lies 1/8 pixel left and 3/8 up of the centre.
      const double sample = (steep ? 0.375 - 0.5 : 0.125 - 0.5) + (b[other] - a[other]) /
                                                                      (b[main_axis] - a[main_axis]) *
                                                                      (steep ? 0.5 - 0.125 : 0.5 - 0.375);
      EXPECT_NEAR(error / (to - from) + sample, 0, 0.1) << "edge " << i;
      ++corners;
    }
  }
  EXPECT_EQ(corners, 8);
}

TEST(Renderer, DepthIsTrueToAMillimetreAtAHundredMetres) {
  Stage stage(
      "[[building]]\nat = [5, 5]\nsize = [20, 20]\nheight = 12.5\n[terrain]\nkind = \"ramp\"\nslope = [0.05, "
      "0.02]\nextent = [300, 300]\n" +
      kSmallCamera);
  const CameraState state = lookingDown(0, 0, 112.5);
  stage.render(state);
  const std::vector<float> depth = *stage.renderer->depth();
  const capture::CameraModel& camera = stage.renderer->camera();
  const Geometry geometry(*stage.world);
  // The first sample of a pixel, where the rasteriser's depth is taken.
  capture::CameraModel shifted = camera;
  shifted.cx += 0.5 - 0.375;
  shifted.cy += 0.5 - 0.125;
  const std::vector<double> exact = traceDepth(geometry, shifted, state);
  std::size_t good = 0;
  for (std::size_t i = 0; i < depth.size(); ++i) good += std::abs(depth[i] - exact[i]) < 1e-3 ? 1 : 0;
  EXPECT_GT(static_cast<double>(good) / static_cast<double>(depth.size()), 0.99);  // edges of the box apart
  EXPECT_NEAR(*std::min_element(depth.begin(), depth.end()), 100 - 0.7, 0.9);
}

}  // namespace
}  // namespace overfly::scene
