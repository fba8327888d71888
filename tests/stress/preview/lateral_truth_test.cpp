// Photographs on steep sides against the truth of a scene: the same view of the scene itself, and of its
// exact elevation and orthophoto with and without photographs. OVERFLY_WRITE_PICTURES=FOLDER writes them.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <span>

#include "render/preview/previewer.h"
#include "render/scene/renderer.h"
#include "render/scene/truth.h"
#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/preview/synthetic_map.h"
#include "tiling/preview/frame_projectors.h"

namespace overfly::preview {
namespace {

using test::SyntheticMap;

struct Case {
  const char* scene;
  int zoom, tiles;
  Eigen::Vector3d view;  // East, North, Up in the scene
  double heading_deg, pitch_deg;
  double ring, ring_height;  // of the photographs around the scene's middle, looking inwards
};

View viewAt(const scene::World& world, const Eigen::Vector3d& enu, double heading_deg, double pitch_deg,
            int width, int height) {
  View view;
  view.position = geo::geodeticFromEcef(world.local.ecefFromEnu(enu));
  view.heading = geo::radians(heading_deg);
  view.pitch = geo::radians(pitch_deg);
  view.fov = geo::radians(65);
  view.width = width;
  view.height = height;
  return view;
}

scene::CameraState stateOf(const scene::World& world, const View& view) {
  const geo::LocalFrame local(view.position);
  scene::CameraState state;
  state.position = world.local.enuFromEcef(geo::ecefFromGeodetic(view.position));
  state.enu_from_camera = Eigen::Quaterniond(Eigen::Matrix3d(
      world.local.enuFromEcefRotation() * local.enuFromEcefRotation().transpose() * view.enuFromCamera()));
  return state;
}

capture::CameraModel lensOf(const View& view) {
  capture::CameraModel lens;
  lens.width = view.width;
  lens.height = view.height;
  lens.fx = lens.fy = view.focal();
  lens.cx = 0.5 * view.width;
  lens.cy = 0.5 * view.height;
  return lens;
}

void write(const std::string& name, int width, int height, std::span<const std::uint8_t> pixels,
           std::size_t channels) {
  const char* folder = std::getenv("OVERFLY_WRITE_PICTURES");
  if (folder == nullptr) return;
  cv::Mat out(height, width, CV_8UC3);
  const std::uint8_t* p = pixels.data();
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x, p += channels) out.at<cv::Vec3b>(y, x) = {p[2], p[1], p[0]};
  cv::imwrite((std::filesystem::path(folder) / (name + ".png")).string(), out);
}

class SidesOfScenes : public test::GlTest, public ::testing::WithParamInterface<Case> {};

TEST_P(SidesOfScenes, LookMoreLikeTheTruthWithPhotographs) {
  const Case& c = GetParam();
  auto description = scene::loadScene(c.scene).value();
  description.effects.clear();  // as the truth's colours are
  const View photo = viewAt(*scene::buildWorld(description).value(), {0, 0, 0}, 0, 0, 960, 720);
  description.camera = lensOf(photo);
  const auto world = scene::buildWorld(description).value();
  const scene::Truth truth(world);
  const View view = viewAt(*world, c.view, c.heading_deg, c.pitch_deg, 480, 320);

  // The exact map around the scene's middle.
  SyntheticMap::Options options;
  options.zoom = c.zoom;
  options.tile_size = 128;
  options.tiles = c.tiles;
  const auto centre =
      options.lattice.planeFromGeodetic(world->local.origin().lat, world->local.origin().lon).value();
  geo::TileKey first = geo::TileLattice::keyAt(centre, c.zoom);
  first.x -= c.tiles / 2;
  first.y -= c.tiles / 2;
  const geo::Geodetic corner = options.lattice.geodeticFromPlane(geo::TileLattice::planeOf(first, 0.5, 0.5));
  options.lat_deg = geo::degrees(corner.lat);
  options.lon_deg = geo::degrees(corner.lon);
  std::map<std::pair<int, int>, scene::TruthTile> tiles;
  for (int y = 0; y < c.tiles; ++y)
    for (int x = 0; x < c.tiles; ++x)
      tiles[{x, y}] = truth.tile(options.lattice, {c.zoom, first.x + x, first.y + y}, options.tile_size);
  const auto texel = [&](int x, int y) {
    const int size = options.tile_size;
    return std::pair{&tiles.at({x / size, y / size}), static_cast<std::size_t>(y % size * size + x % size)};
  };
  options.color = [&](int x, int y) {
    const auto [tile, i] = texel(x, y);
    return std::array<std::uint8_t, 3>{tile->color[4 * i], tile->color[4 * i + 1], tile->color[4 * i + 2]};
  };
  SyntheticMap map(options, [&](int x, int y) {
    const auto [tile, i] = texel(x, y);
    return tile->elevation[i];
  });
  ASSERT_EQ(map.corner(), first);

  auto renderer = scene::Renderer::create(context(), world).value();
  std::map<std::uint64_t, scene::CameraState> states;
  std::vector<tiling::FrameRecord> records;
  for (std::uint64_t i = 0; i < 16; ++i) {
    const double angle = geo::radians(22.5 * static_cast<double>(i));
    const View from = viewAt(*world, {-c.ring * std::sin(angle), -c.ring * std::cos(angle), c.ring_height},
                             22.5 * static_cast<double>(i), -38, photo.width, photo.height);
    states[i] = stateOf(*world, from);
    tiling::FrameRecord record;
    record.id = i;
    record.camera = description.camera;
    record.pose = scene::poseOf(world->local, states[i], 0);
    records.push_back(record);
  }
  int rendered = 0;
  tiling::FrameProjectors photographs(options.lattice, records, world->local.origin().height_m,
                                      [&](const tiling::FrameRecord& frame) -> Result<capture::Image> {
                                        auto picture = renderer->render(states[frame.id], {}, 0, 0);
                                        if (!picture) return tl::unexpected(picture.error());
                                        ++rendered;
                                        capture::Image image;
                                        image.format = capture::PixelFormat::Rgb8;
                                        image.width = picture->width;
                                        image.height = picture->height;
                                        image.stride = 3 * image.width;
                                        image.bytes = std::move(picture->rgb);
                                        return image;
                                      });

  RamCache ram(map);
  Previewer previewer(context(), ram);
  previewer.setProjectors(&photographs);
  Look look;
  look.relief = 0;
  const auto before = previewer.drawSettled(view, look);
  ASSERT_TRUE(before.has_value()) << before.error().message;
  look.projectors = 8;
  const auto after = previewer.drawSettled(view, look);
  ASSERT_TRUE(after.has_value()) << after.error().message;
  EXPECT_GE(rendered, 2);
  EXPECT_EQ(rendered, after->projectors);
  look.projector_grazing = 0;
  const auto thesis = previewer.drawSettled(view, look);
  ASSERT_TRUE(thesis.has_value()) << thesis.error().message;

  description.camera = lensOf(view);
  const auto seen = scene::buildWorld(description).value();
  auto eye = scene::Renderer::create(context(), seen).value();
  const auto expected = eye->render(stateOf(*seen, view), {}, 0, 0).value();
  // Where photographs colour: how far off the truth, per channel.
  const auto pixels = static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height);
  struct Errors {
    double before = 0, after = 0;
    std::size_t changed = 0;
  };
  const auto errorsOf = [&](const Picture& with) {
    Errors errors;
    for (std::size_t i = 0; i < pixels; ++i) {
      const std::uint8_t *a = &before->picture.rgba[4 * i], *b = &with.rgba[4 * i];
      if (std::equal(a, a + 3, b)) continue;
      ++errors.changed;
      for (std::size_t k = 0; k < 3; ++k) {
        errors.before += std::abs(a[k] - expected.rgb[3 * i + k]) / 3.0;
        errors.after += std::abs(b[k] - expected.rgb[3 * i + k]) / 3.0;
      }
    }
    const auto count = static_cast<double>(std::max<std::size_t>(errors.changed, 1));
    errors.before /= count;
    errors.after /= count;
    return errors;
  };
  const Errors errors = errorsOf(after->picture), nearest = errorsOf(thesis->picture);
  std::printf(
      "%s: %d photographs colour %.1f %% of the pixels; off the truth there by %.1f without, %.1f with, %.1f "
      "where the nearest wins at any angle\n",
      c.scene, after->projectors, 100.0 * static_cast<double>(errors.changed) / static_cast<double>(pixels),
      errors.before, errors.after, nearest.after);
  write(std::string(c.scene) + "-before", view.width, view.height, before->picture.rgba, 4);
  write(std::string(c.scene) + "-after", view.width, view.height, after->picture.rgba, 4);
  write(std::string(c.scene) + "-truth", view.width, view.height, expected.rgb, 3);
  EXPECT_GT(errors.changed, pixels / 10);
  EXPECT_LT(errors.after, 0.7 * errors.before);
  EXPECT_LE(errors.after, nearest.after);
}
INSTANTIATE_TEST_SUITE_P(Scenes, SidesOfScenes,
                         ::testing::Values(Case{"city", 20, 8, {-70, -80, 85}, 42, -32, 110, 110},
                                           Case{"canyon", 19, 6, {-120, -40, 215}, 70, -38, 130, 250}),
                         [](const auto& tested) { return std::string(tested.param.scene); });

}  // namespace
}  // namespace overfly::preview
