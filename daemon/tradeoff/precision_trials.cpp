#include "daemon/tradeoff/precision_trials.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <limits>

#include "capture/geo/footprint.h"
#include "capture/geo/tile_frame.h"
#include "render/gl/commands.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"
#include "tradeoff_shaders.h"

namespace overfly::tradeoff {
namespace {

constexpr int kSize = 256;
constexpr double kMillion = 1e6 / (kSize * kSize);
constexpr double kHeight = 523.7;  // of the ground, metres

// A camera 100 m above the tile's middle, as rows of image_from_tile (pixels, homogeneous).
struct Camera {
  Eigen::Matrix3d linear;
  Eigen::Vector3d offset;

  explicit Camera(const geo::TileFrame& frame) {
    const Eigen::Vector3d centre = frame.enuFromTexelExact(0.53, 0.46, kHeight + 100);
    const Eigen::Matrix3d camera_from_tile =
        geo::enuFromCamera(geo::radians(37), geo::radians(-85), geo::radians(1))
            .toRotationMatrix()
            .transpose();
    Eigen::Matrix3d image;
    image << 2200, 0, 2000, 0, 2200, 1500, 0, 0, 1;
    linear = image * camera_from_tile;
    offset = -linear * centre;
  }
  [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& point) const {
    return (linear * point + offset).hnormalized();
  }
};

// A frame that the tile's coordinates are expressed in: x_in_frame = linear * x_in_tile + offset.
struct Rebased {
  std::string name;
  Eigen::Matrix3d linear = Eigen::Matrix3d::Identity();
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
};

}  // namespace

Result<std::vector<Trial>> tryPrecision(gl::Context& context, int repeats) {
  const geo::TileLattice lattice = geo::TileLattice::webMercator();
  auto plane = lattice.planeFromGeodetic(geo::radians(47.4), geo::radians(9.7));
  if (!plane) return fail(ErrorCode::Internal, "the lattice does not reach 47 N");
  const geo::TileFrame frame(lattice, geo::TileLattice::keyAt(*plane, 21));
  const Camera camera(frame);
  std::vector<Eigen::Vector2d> exact(static_cast<std::size_t>(kSize) * kSize);
  const auto forTexels = [&](auto&& work) {
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x)
        work(static_cast<std::size_t>(y) * kSize + static_cast<std::size_t>(x), (x + 0.5) / kSize,
             (y + 0.5) / kSize);
  };
  std::vector<Trial> trials;
  const auto add = [&](const std::string& axis, const std::string& setting, bool is_default,
                       const std::function<Result<void>()>& work,
                       const std::function<double()>& error) -> Result<void> {
    std::vector<double> processor, wall;
    for (int run = 0; run <= repeats; ++run) {
      Result<void> done{};
      const Elapsed elapsed = elapsedOf([&] { done = work(); });
      if (!done) return done;
      if (run == 0) continue;
      processor.push_back(kMillion * elapsed.processor_ms);
      wall.push_back(kMillion * elapsed.wall_ms);
    }
    trials.push_back({.part = "precision",
                      .axis = axis,
                      .setting = setting,
                      .is_default = is_default,
                      .processor = timingOf(processor),
                      .wall = timingOf(wall),
                      .error_name = "largest error, pixels",
                      .error = error(),
                      .figures = {}});
    return {};
  };
  std::vector<Eigen::Vector2d> out(exact.size());
  const auto largest = [&] {
    double most = 0;
    for (std::size_t i = 0; i < out.size(); ++i) most = std::max(most, (out[i] - exact[i]).norm());
    return most;
  };
  if (auto ok = add(
          "double on the CPU", "exact projection of the lattice", false,
          [&]() -> Result<void> {
            forTexels([&](std::size_t i, double u, double v) {
              exact[i] = camera.project(frame.enuFromTexelExact(u, v, kHeight));
            });
            return {};
          },
          [] { return 0.0; });
      !ok)
    return tl::unexpected(ok.error());
  if (auto ok = add(
          "double on the CPU", "the tile frame's polynomial", false,
          [&]() -> Result<void> {
            forTexels([&](std::size_t i, double u, double v) {
              out[i] = camera.project(frame.enuFromTexel(u, v, kHeight));
            });
            return {};
          },
          largest);
      !ok)
    return tl::unexpected(ok.error());

  std::vector<Rebased> frames{{"the tile's own frame"}};
  const Eigen::Matrix3d ecef_from_tile = frame.local().enuFromEcefRotation().transpose();
  const Eigen::Vector3d tile_in_ecef = frame.local().ecefFromEnu(Eigen::Vector3d::Zero());
  const geo::Geodetic place = geo::geodeticFromEcef(tile_in_ecef);
  for (const double km : {1.0, 30.0, 1000.0}) {
    geo::Geodetic origin = place;
    origin.lat -= km * 1000 / 6.37e6;
    const geo::LocalFrame far(origin);
    frames.push_back({fmt::format("a frame {:g} km away", km), far.enuFromEcefRotation() * ecef_from_tile,
                      far.enuFromEcef(tile_in_ecef)});
  }
  frames.push_back({"ECEF", ecef_from_tile, tile_in_ecef});

  const gl::ShaderFile file{"project.frag", shaders::tradeoff::project_frag};
  auto program = gl::Program::fullScreen(context, std::span(&file, 1));
  if (!program) return tl::unexpected(program.error());
  auto texture = gl::Texture::create(context, {.format = gl::Format::RGBA32F,
                                               .width = kSize,
                                               .height = kSize,
                                               .sampling = {gl::Filter::Nearest, gl::Filter::Nearest}});
  if (!texture) return tl::unexpected(texture.error());
  const std::array attachments{gl::Attachment{&*texture, 0, 0}};
  auto target = gl::Framebuffer::create(context, attachments);
  if (!target) return tl::unexpected(target.error());
  std::vector<float> pixels(4 * exact.size());
  for (const Rebased& rebased : frames) {
    std::vector<Eigen::Vector3f> ground, up;
    for (std::size_t i = 0; i < frame.ground().size(); ++i)
      ground.push_back(
          (rebased.linear * frame.ground()[i] + (i == 0 ? rebased.offset : Eigen::Vector3d::Zero()))
              .cast<float>());
    for (const Eigen::Vector3d& term : frame.up()) up.push_back((rebased.linear * term).cast<float>());
    const Eigen::Matrix3d linear = camera.linear * rebased.linear.transpose();
    const Eigen::Vector3d offset = camera.offset - linear * rebased.offset;
    std::vector<Eigen::Vector4f> rows;
    for (int row = 0; row < 3; ++row)
      rows.emplace_back(
          Eigen::Vector4d(linear(row, 0), linear(row, 1), linear(row, 2), offset(row)).cast<float>());
    program->set("ground", std::span<const Eigen::Vector3f>(ground));
    program->set("up", std::span<const Eigen::Vector3f>(up));
    program->set("image_from_frame", std::span<const Eigen::Vector4f>(rows));
    program->set("height", static_cast<float>(kHeight));
    program->set("size", static_cast<float>(kSize));
    if (auto ok = add(
            "float32 on the GPU", rebased.name, &rebased == &frames.front(),
            [&]() -> Result<void> {
              gl::drawFullScreen(*program, *target);
              return texture->download(std::span<float>(pixels));
            },
            [&] {
              for (std::size_t i = 0; i < out.size(); ++i)
                out[i] = {static_cast<double>(pixels[4 * i]), static_cast<double>(pixels[4 * i + 1])};
              return largest();
            });
        !ok)
      return tl::unexpected(ok.error());
  }
  return trials;
}

}  // namespace overfly::tradeoff
