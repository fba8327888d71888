#include "render/scene/renderer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "render/scene/detail/geometry_pass.h"
#include "render/scene/detail/picture_passes.h"

namespace overfly::scene {
namespace {

// The smallest pinhole of the sensor's focal length that holds everything the distorted sensor sees, with two
// pixels to spare for the filter.
RenderCamera idealCamera(const capture::CameraModel& sensor) {
  if (sensor.kind == capture::CameraModel::Kind::Pinhole)
    return {sensor.width, sensor.height, sensor.fx, sensor.fy, sensor.cx, sensor.cy};
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double x0 = kInfinity, x1 = -kInfinity, y0 = kInfinity, y1 = -kInfinity;
  constexpr int kSteps = 64;
  for (int i = 0; i <= kSteps; ++i) {
    const double s = static_cast<double>(i) / kSteps;
    for (const Eigen::Vector2d& border :
         {Eigen::Vector2d(s, 0), Eigen::Vector2d(s, 1), Eigen::Vector2d(0, s), Eigen::Vector2d(1, s)}) {
      const auto direction = sensor.unproject({border.x() * sensor.width, border.y() * sensor.height});
      if (!direction) continue;
      const Eigen::Vector3d q = *direction / direction->z();
      x0 = std::min(x0, sensor.fx * q.x());
      x1 = std::max(x1, sensor.fx * q.x());
      y0 = std::min(y0, sensor.fy * q.y());
      y1 = std::max(y1, sensor.fy * q.y());
    }
  }
  RenderCamera camera{0, 0, sensor.fx, sensor.fy, std::ceil(2 - x0), std::ceil(2 - y0)};
  camera.width = static_cast<int>(std::ceil(camera.cx + x1 + 2));
  camera.height = static_cast<int>(std::ceil(camera.cy + y1 + 2));
  return camera;
}

}  // namespace

capture::CameraModel effectiveCamera(const SceneDescription& scene) {
  capture::CameraModel camera = scene.camera;
  if (const EffectSettings* lens = findEffect(scene.effects, Effect::LensDistortion)) {
    camera.kind = capture::CameraModel::Kind::RadialTangential;
    camera.distortion = {(*lens)["k1"], (*lens)["k2"], (*lens)["p1"], (*lens)["p2"], (*lens)["k3"]};
  }
  return camera;
}

class Renderer::Impl {
 public:
  Impl(gl::Context& context, std::shared_ptr<const World> world)
      : context_(context),
        world_(std::move(world)),
        camera_(effectiveCamera(world_->description)),
        ideal_(idealCamera(camera_)),
        path_(world_->description.path, world_->description.camera, world_->description.seed) {}

  Result<void> build() {
    const std::vector<EffectSettings>& effects = world_->description.effects;
    Result<std::unique_ptr<GeometryPass>> geometry =
        GeometryPass::create(context_, *world_, ideal_, world_->description.camera, effects);
    if (!geometry) return tl::unexpected<Error>(geometry.error());
    geometry_ = std::move(*geometry);
    auto passes = makePasses({context_, *world_, world_->description.camera, ideal_, path_}, effects);
    if (!passes) return tl::unexpected<Error>(passes.error());
    passes_ = std::move(*passes);
    bool on_sensor = false;
    for (std::size_t i = 0; i < passes_.size(); ++i) {
      on_sensor = on_sensor || passes_[i]->effect() == Effect::LensDistortion;
      gl::TextureSpec spec;
      // What lies between passes keeps more than eight bits: only the sensor quantises.
      spec.format = i + 1 == passes_.size() ? gl::Format::RGBA8 : gl::Format::RGBA16F;
      spec.width = on_sensor ? camera_.width : ideal_.width;
      spec.height = on_sensor ? camera_.height : ideal_.height;
      Result<gl::Texture> texture = gl::Texture::create(context_, spec);
      if (!texture) return tl::unexpected<Error>(texture.error());
      pictures_.push_back(std::move(*texture));
    }
    for (const gl::Texture& picture : pictures_) {
      Result<gl::Framebuffer> target = gl::Framebuffer::create(context_, picture);
      if (!target) return tl::unexpected<Error>(target.error());
      targets_.push_back(std::move(*target));
    }
    return {};
  }

  Result<Picture> render(const CameraState& state, const CameraMotion& motion, double time_s, int frame) {
    cost_ = {};
    view_ = {ideal_, state, motion, time_s};
    const auto start = std::chrono::steady_clock::now();
    if (Result<void> drawn = geometry_->draw(view_); !drawn) return tl::unexpected<Error>(drawn.error());
    finishPass(start, "geometry");
    if (geometry_->counts().passes > 1)
      cost_.passes.insert(cost_.passes.begin(), {"sun_shadows", 0});  // timed with the geometry
    cost_.draws = geometry_->counts().draws;
    cost_.triangles = geometry_->counts().triangles;
    cost_.plants = geometry_->counts().plants;
    const gl::Texture* picture = &geometry_->color();
    for (std::size_t i = 0; i < passes_.size(); ++i) {
      const auto pass_start = std::chrono::steady_clock::now();
      passes_[i]->prepare(view_, frame);
      passes_[i]->run(*picture, geometry_->depth(), view_, targets_[i]);
      finishPass(pass_start, std::string(infoOf(passes_[i]->effect()).name));
      picture = &pictures_[i];
    }
    const auto bytes =
        static_cast<std::size_t>(picture->width()) * static_cast<std::size_t>(picture->height());
    rgba_.resize(4 * bytes);
    if (Result<void> read = picture->download(std::span(rgba_)); !read)
      return tl::unexpected<Error>(read.error());
    if (Result<void> good = context_.check(); !good) return tl::unexpected<Error>(good.error());
    Picture result{picture->width(), picture->height(), std::vector<std::uint8_t>(3 * bytes)};
    for (std::size_t i = 0; i < bytes; ++i) {
      result.rgb[3 * i] = rgba_[4 * i];
      result.rgb[3 * i + 1] = rgba_[4 * i + 1];
      result.rgb[3 * i + 2] = rgba_[4 * i + 2];
    }
    return result;
  }

  Result<std::vector<float>> depth() {
    Result<gl::Program> reader = makeDepthReader(context_);
    if (!reader) return tl::unexpected<Error>(reader.error());
    gl::TextureSpec spec;
    spec.format = gl::Format::R32F;
    spec.width = ideal_.width;
    spec.height = ideal_.height;
    Result<gl::Texture> texture = gl::Texture::create(context_, spec);
    if (!texture) return tl::unexpected<Error>(texture.error());
    Result<gl::Framebuffer> target = gl::Framebuffer::create(context_, *texture);
    if (!target) return tl::unexpected<Error>(target.error());
    setDepthInputs(*reader, geometry_->depth(), view_);
    gl::drawFullScreen(*reader, *target);
    std::vector<float> depth(static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height));
    if (Result<void> read = texture->download(std::span(depth)); !read)
      return tl::unexpected<Error>(read.error());
    return depth;
  }

  void finishPass(std::chrono::steady_clock::time_point start, std::string name) {
    double milliseconds = 0;
    if (measure_) {
      context_.finish();
      milliseconds =
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    }
    cost_.passes.push_back({std::move(name), milliseconds});
  }

  gl::Context& context_;
  std::shared_ptr<const World> world_;
  capture::CameraModel camera_;
  RenderCamera ideal_;
  FlightPath path_;
  std::unique_ptr<GeometryPass> geometry_;
  std::vector<std::unique_ptr<PicturePass>> passes_;
  std::vector<gl::Texture> pictures_;
  std::vector<gl::Framebuffer> targets_;
  std::vector<std::uint8_t> rgba_;
  View view_;
  FrameCost cost_;
  bool measure_ = false;
};

Renderer::Renderer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Renderer::~Renderer() = default;

Result<std::unique_ptr<Renderer>> Renderer::create(gl::Context& context, std::shared_ptr<const World> world) {
  auto impl = std::make_unique<Impl>(context, std::move(world));
  if (Result<void> built = impl->build(); !built) return tl::unexpected<Error>(built.error());
  return std::unique_ptr<Renderer>(new Renderer(std::move(impl)));
}

Result<Picture> Renderer::render(int frame) {
  const double time_s = impl_->path_.timeOf(frame);
  return impl_->render(impl_->path_.at(time_s), impl_->path_.motionAt(time_s), time_s, frame);
}

Result<Picture> Renderer::render(const CameraState& state, const CameraMotion& motion, double time_s,
                                 int frame) {
  return impl_->render(state, motion, time_s, frame);
}

Result<std::vector<float>> Renderer::depth() { return impl_->depth(); }
void Renderer::measure(bool on) { impl_->measure_ = on; }
const FrameCost& Renderer::lastCost() const { return impl_->cost_; }
const FlightPath& Renderer::path() const { return impl_->path_; }
const capture::CameraModel& Renderer::camera() const { return impl_->camera_; }

}  // namespace overfly::scene
