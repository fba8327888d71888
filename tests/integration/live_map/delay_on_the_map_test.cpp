#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <set>

#include "render/scene/renderer.h"
#include "render/scene/truth.h"
#include "tests/integration/live/simulated_flight.h"
#include "tests/unit/gl/gl_fixture.h"
#include "tiling/mapping/mapper.h"

// What a delay between camera and autopilot does to the map, and what is left of it: a flight at 15 m/s over
// a scene, through LiveSource and Mapper, held against the scene's truth.
namespace overfly {
namespace {

using capture::kMs;
using capture::kSecond;

constexpr double kGround = 450, kTexel = 0.25;  // metres; the simulated flight is at 500 m
constexpr int kTileSize = 64;

// Textured ground without anything on it, along the simulated flight's way.
std::shared_ptr<const scene::World> ground() {
  auto scene = scene::parseScene(R"(
name = "strip"
seed = 3
base = "meadow"
[place]
lat_deg = 47.4
lon_deg = 8.5
height_m = 450
[terrain]
kind = "flat"
extent = [120, 500]
spacing = 10
[[area]]
base = "gravel"
polygon = [[-8, -40], [6, -40], [14, 240], [-2, 240]]
[[area]]
base = "soil"
polygon = [[6, -40], [50, -40], [40, 240], [14, 240]]
[camera]
width = 160
height = 160
fx = 200
)",
                                 "strip.toml");
  if (!scene) throw std::runtime_error(scene.error().message);
  return *scene::buildWorld(*scene);
}

// The pictures that a camera takes at these moments, looking straight down with north up.
std::vector<capture::FramePtr> photographed(scene::Renderer& renderer, const scene::World& world,
                                            const capture::Truth& truth,
                                            const capture::SimulatedCamera& camera,
                                            const std::vector<capture::FramePtr>& frames) {
  std::vector<capture::FramePtr> out;
  for (const capture::FramePtr& frame : frames) {
    scene::CameraState state;
    state.enu_from_camera = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
    state.position = world.local.enuFromEcef(truth.at(camera.taken(frame->sequence)));
    auto picture = renderer.render(state, {}, 0, 0);
    if (!picture) throw std::runtime_error(picture.error().message);
    auto taken = std::make_shared<capture::Frame>(*frame);
    taken->camera = renderer.camera();
    taken->image = {capture::PixelFormat::Rgb8, picture->width, picture->height, 3 * picture->width,
                    std::move(picture->rgb)};
    out.push_back(std::move(taken));
  }
  return out;
}

std::map<geo::TileKey, tiling::Tile> mapOf(gl::Context& context,
                                           const std::vector<capture::FramePtr>& frames) {
  tiling::MapperOptions options;
  options.tile_size = kTileSize;
  auto made = tiling::Mapper::create(context, options);
  if (!made) throw std::runtime_error(made.error().message);
  tiling::Mapper& mapper = **made;
  const double lat = geo::radians(47.4), lon = geo::radians(8.5);
  tiling::MapGround ground;
  ground.base_zoom = ground.lattice.zoomForGsd(kTexel, lat, lon, kTileSize);
  ground.gsd_m = kTexel;
  ground.texel_m = ground.lattice.texelSize(ground.base_zoom, lat, lon, kTileSize);
  ground.height_m = kGround;
  ground.min_height_m = kGround - 6;
  ground.max_height_m = kGround + 6;
  ground.anchor_px = ground.lattice.planeFromGeodetic(lat, lon)->x();
  mapper.setGround(ground);
  std::set<geo::TileKey> cells;
  for (const capture::FramePtr& frame : frames) {
    const auto touched =
        mapper.addFrame(frame->sequence, frame, [frame] { return Result<capture::FramePtr>(frame); });
    if (!touched) throw std::runtime_error(touched.error().message);
    cells.insert(touched->begin(), touched->end());
  }
  std::map<geo::TileKey, tiling::Tile> tiles;
  for (const geo::TileKey& cell : cells) {
    auto finished = mapper.finishCell(cell);
    if (!finished) throw std::runtime_error(finished.error().message);
    for (tiling::Tile& tile : *finished) tiles.insert_or_assign(tile.key, std::move(tile));
  }
  return tiles;
}

// Where the content of a tile lies against the truth's, metres (east, north): the place of the best
// correlation of its inner part, to a part of a texel by a parabola through its neighbours. nullopt: not a
// whole tile.
std::optional<Eigen::Vector2d> shiftOf(const tiling::Tile& tile, const scene::TruthTile& truth,
                                       double texel_m) {
  constexpr int kReach = 6;
  for (std::size_t i = 0; i < tile.texels(); ++i)
    if (tile.color[4 * i + 3] == 0 || truth.color[4 * i + 3] == 0) return std::nullopt;
  const auto green = [](const std::vector<std::uint8_t>& color, int x, int y) {
    return static_cast<double>(color[4 * static_cast<std::size_t>(y * kTileSize + x) + 1]);
  };
  const auto correlation = [&](int east, int south) {
    double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
    for (int y = kReach + 1; y < kTileSize - kReach - 1; ++y)
      for (int x = kReach + 1; x < kTileSize - kReach - 1; ++x) {
        const double p = green(tile.color, x + east, y + south), q = green(truth.color, x, y);
        n += 1, a += p, b += q, aa += p * p, bb += q * q, ab += p * q;
      }
    return (ab - a * b / n) / std::sqrt((aa - a * a / n) * (bb - b * b / n));
  };
  int east = 0, south = 0;
  double best = -2;
  for (int y = -kReach; y <= kReach; ++y)
    for (int x = -kReach; x <= kReach; ++x)
      if (const double c = correlation(x, y); c > best) best = c, east = x, south = y;
  if (std::abs(east) == kReach || std::abs(south) == kReach || best < 0.5) return std::nullopt;
  const auto top = [&](double before, double after) {
    return 0.5 * (before - after) / (before - 2 * best + after);
  };
  return texel_m *
         Eigen::Vector2d(east + top(correlation(east - 1, south), correlation(east + 1, south)),
                         -(south + top(correlation(east, south - 1), correlation(east, south + 1))));
}

class DelayOnTheMap : public test::GlTest {
 protected:
  void SetUp() override {
    test::GlTest::SetUp();
    world_ = ground();
    auto made = scene::Renderer::create(context(), world_);
    ASSERT_TRUE(made) << made.error().message;
    renderer_ = std::move(*made);
    truth_ = std::make_unique<scene::Truth>(world_);
  }

  // Median shift of the map's whole tiles against the truth, metres (east, north).
  Eigen::Vector2d shiftOfTheMap(capture::LiveOptions options) {
    options.mount.body_from_camera = capture::bodyFromCamera(0, -M_PI / 2, 0);
    capture::SimulatedFlight flight(options, 40 * kMs);
    flight.flyFrames(options.pulses == capture::PulsesFrom::None ? 45 : 70);
    // Behind the time that pulses, clocks and poses take to settle.
    std::vector<capture::FramePtr> settled;
    for (std::size_t i = flight.frames.size() - 30; i < flight.frames.size(); ++i)
      if (flight.frames[i]->pose) settled.push_back(flight.frames[i]);
    EXPECT_GT(settled.size(), 25U);
    const auto tiles =
        mapOf(context(), photographed(*renderer_, *world_, flight.truth, *flight.camera, settled));
    const auto lattice = geo::TileLattice::webMercator();
    std::vector<double> east, north;
    for (const auto& [key, tile] : tiles) {
      const double texel = lattice.texelSize(key.zoom, geo::radians(47.4), geo::radians(8.5), kTileSize);
      const auto shift = shiftOf(tile, truth_->tile(lattice, key, kTileSize), texel);
      if (!shift) continue;
      east.push_back(shift->x());
      north.push_back(shift->y());
    }
    EXPECT_GE(east.size(), 4U);
    if (east.empty()) return {1e9, 1e9};
    std::sort(east.begin(), east.end());
    std::sort(north.begin(), north.end());
    std::printf("%zu tiles: east %.3f m (%.3f to %.3f), north %.3f m (%.3f to %.3f)\n", east.size(),
                east[east.size() / 2], east.front(), east.back(), north[north.size() / 2], north.front(),
                north.back());
    return {east[east.size() / 2], north[north.size() / 2]};
  }

  std::shared_ptr<const scene::World> world_;
  std::unique_ptr<scene::Renderer> renderer_;
  std::unique_ptr<scene::Truth> truth_;
};

// 15 m/s times 40 ms are 0.6 m. A stamp that is late gives the pose of a later moment, further north.
TEST_F(DelayOnTheMap, AnUnknownDelayShiftsTheMapAlongTheFlight) {
  const Eigen::Vector2d shift = shiftOfTheMap({});
  EXPECT_NEAR(shift.x(), 0, 0.06);
  EXPECT_NEAR(shift.y(), 0.6, 0.1);
}

TEST_F(DelayOnTheMap, ASetDelayIsGoneFromTheMap) {
  capture::LiveOptions options;
  options.mount.delay_ns = -40 * kMs;
  const Eigen::Vector2d shift = shiftOfTheMap(options);
  EXPECT_NEAR(shift.x(), 0, 0.06);
  EXPECT_NEAR(shift.y(), 0, 0.1);
}

TEST_F(DelayOnTheMap, ADelayThatPulsesTellIsGoneFromTheMap) {
  capture::LiveOptions options;
  options.pulses = capture::PulsesFrom::Gpio;
  const Eigen::Vector2d shift = shiftOfTheMap(options);
  EXPECT_NEAR(shift.x(), 0, 0.06);
  EXPECT_NEAR(shift.y(), 0, 0.1);
}

}  // namespace
}  // namespace overfly
