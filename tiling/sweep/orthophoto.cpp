#include "tiling/sweep/orthophoto.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "render/gl/commands.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "sweep_shaders.h"
#include "tiling/sweep/detail/hidden_views.h"
#include "tiling/sweep/detail/view_geometry.h"
#include "tiling/sweep/height_filter.h"

namespace overfly::tiling {
namespace {

constexpr std::uint16_t kNoSource = 65535;
// Texels by which whatever stands up hides more than it is wide: a swept edge lies up to two texels off the
// true one, and what passes close by it may show its wall.
constexpr int kDoubtfulEdge = 2;

struct Targets {
  gl::Texture color, source, detail;
  gl::Framebuffer into;
};

struct SurfaceMaps {
  gl::Texture height, widened, provisional, hidden;  // hidden: of the cell alone
  gl::Framebuffer into_hidden;
};

}  // namespace

struct Orthographer::Impl {
  explicit Impl(gl::Context& borrowed) : context(&borrowed), hidden(borrowed) {}
  gl::Context* context;
  detail::HiddenViews hidden;
  std::map<std::pair<int, Fallback>, gl::Program> programs;  // by number of views
  std::map<int, Targets> targets;                            // by size
  std::map<std::pair<int, int>, SurfaceMaps> surfaces;       // by texels and apron

  Result<gl::Program*> programFor(int views, Fallback fallback) {
    const std::pair key(views, fallback);
    if (const auto found = programs.find(key); found != programs.end()) return &found->second;
    const std::array files{gl::ShaderFile{"texel_rays.glsl", shaders::sweep::texel_rays_glsl},
                           gl::ShaderFile{"orthophoto.frag", shaders::sweep::orthophoto_frag}};
    std::vector<gl::Define> defines = viewDefines(views);
    defines.push_back({"BLEND_FROM", "0.80"});
    defines.push_back({"FALLBACK", std::to_string(static_cast<int>(fallback))});
    auto program = gl::Program::fullScreen(*context, files, defines);
    if (!program) return tl::unexpected(program.error());
    return &programs.emplace(key, std::move(*program)).first->second;
  }

  Result<gl::Texture> texture(gl::Format format, int side, gl::Filter filter) {
    return gl::Texture::create(
        *context, {.format = format, .width = side, .height = side, .sampling = {filter, filter}});
  }

  Result<Targets*> targetsOf(int size) {
    if (const auto found = targets.find(size); found != targets.end()) return &found->second;
    auto color = texture(gl::Format::RGBA8, size, gl::Filter::Nearest);
    auto source = texture(gl::Format::RGBA8, size, gl::Filter::Nearest);
    auto detail = texture(gl::Format::RGBA16F, size, gl::Filter::Nearest);
    if (!color) return tl::unexpected(color.error());
    if (!source) return tl::unexpected(source.error());
    if (!detail) return tl::unexpected(detail.error());
    Targets& made = targets[size];
    made.color = std::move(*color);
    made.source = std::move(*source);
    made.detail = std::move(*detail);
    const std::array attachments{gl::Attachment{&made.color, 0, 0}, gl::Attachment{&made.source, 0, 0},
                                 gl::Attachment{&made.detail, 0, 0}};
    auto into = gl::Framebuffer::create(*context, attachments);
    if (!into) return tl::unexpected(into.error());
    made.into = std::move(*into);
    return &made;
  }

  Result<SurfaceMaps*> mapsOf(const OrthoSurface& surface) {
    const std::pair key(surface.texels, surface.apron);
    if (const auto found = surfaces.find(key); found != surfaces.end()) return &found->second;
    const int side = surface.texels + 2 * surface.apron;
    // 32-bit float textures are not filterable everywhere: the shader reads the nearest height.
    auto height = texture(gl::Format::R32F, side, gl::Filter::Nearest);
    if (!height) return tl::unexpected(height.error());
    auto widened = texture(gl::Format::R32F, side, gl::Filter::Nearest);
    if (!widened) return tl::unexpected(widened.error());
    auto provisional = texture(gl::Format::R8, side, gl::Filter::Nearest);
    if (!provisional) return tl::unexpected(provisional.error());
    auto marks = texture(gl::Format::R32F, surface.texels, gl::Filter::Nearest);
    if (!marks) return tl::unexpected(marks.error());
    SurfaceMaps& made = surfaces[key];
    made.height = std::move(*height);
    made.widened = std::move(*widened);
    made.provisional = std::move(*provisional);
    made.hidden = std::move(*marks);
    const std::array attachments{gl::Attachment{&made.hidden, 0, 0}};
    auto into = gl::Framebuffer::create(*context, attachments);
    if (!into) return tl::unexpected(into.error());
    made.into_hidden = std::move(*into);
    return &made;
  }
};

Orthographer::Orthographer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Orthographer::~Orthographer() = default;

Result<std::unique_ptr<Orthographer>> Orthographer::create(gl::Context& context) {
  return std::unique_ptr<Orthographer>(new Orthographer(std::make_unique<Impl>(context)));
}

Result<Orthophoto> Orthographer::render(const OrthoSurface& surface, std::span<const OrthoView> all_views,
                                        int size, Fallback fallback) {
  const auto views = all_views.first(std::min<std::size_t>(all_views.size(), kMaxViews));
  const std::size_t texels = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  Orthophoto photo;
  photo.size = size;
  photo.color.assign(texels * 4, 0);
  photo.source.assign(texels, kNoSource);
  photo.seen_by.assign(texels, 0);
  photo.provisional.assign(texels, 0);
  photo.gsd_m.assign(texels, 0.0f);
  photo.tilt.assign(texels, 0.0f);
  if (views.empty()) return photo;

  const auto [lowest, highest] = std::minmax_element(surface.height.begin(), surface.height.end());
  std::vector<SweepView> rays;
  for (const OrthoView& view : views) rays.push_back({view.frame_id, nullptr, view.camera, view.pose});
  const ViewGeometry geometry = viewGeometry(rays, *surface.frame, *lowest, *lowest);
  const auto reference = static_cast<float>(geometry.reference_height_m);
  std::vector<float> height(surface.height.begin(), surface.height.end());
  for (float& h : height) h -= reference;
  std::vector<std::uint8_t> provisional(surface.provisional.begin(), surface.provisional.end());
  for (std::uint8_t& p : provisional) p = p != 0 ? 255 : 0;

  const int side = surface.texels + 2 * surface.apron;
  auto maps = impl_->mapsOf(surface);
  if (!maps) return tl::unexpected(maps.error());
  (*maps)->height.upload(std::span<const float>(height));
  (*maps)->provisional.upload(std::span<const std::uint8_t>(provisional));
  const std::vector<float> widened = highestAround(height, side, kDoubtfulEdge);
  (*maps)->widened.upload(std::span<const float>(widened));
  const detail::Occluder occluder{widened, surface.texels, surface.apron, &(*maps)->widened,
                                  &(*maps)->height};
  const double texel_m = 2.0 * surface.frame->ground()[1].head<2>().norm() / surface.texels;
  if (auto ok = impl_->hidden.mark(geometry, surface.texels, 0, occluder, nullptr,
                                   {.rim = 1.5 + kDoubtfulEdge, .clearance_m = 0.35 * texel_m, .share = 0.05},
                                   (*maps)->into_hidden);
      !ok)
    return tl::unexpected(ok.error());
  auto program = impl_->programFor(static_cast<int>(views.size()), fallback);
  if (!program) return tl::unexpected(program.error());
  auto targets = impl_->targetsOf(size);
  if (!targets) return tl::unexpected(targets.error());

  gl::Program& p = **program;
  setRays(p, geometry, rays, size, 0);
  for (std::size_t k = 0; k < views.size(); ++k)
    p.setTexture("views[" + std::to_string(k) + "]", static_cast<int>(k) + 3, *views[k].color);
  p.setTexture("surface", 0, (*maps)->height);
  p.setTexture("provisional", 1, (*maps)->provisional);
  p.setTexture("hidden_views", 2, (*maps)->hidden);
  p.set("hidden_from_texel", static_cast<float>(surface.texels) / static_cast<float>(size));
  const double scale = static_cast<double>(surface.texels) / size / side;
  const double offset = static_cast<double>(surface.apron) / side;
  p.set("surface_from_texel", Eigen::Vector4d(scale, scale, offset, offset).cast<float>().eval());
  std::vector<float> gain, worth, focal;
  for (const OrthoView& view : views) {
    gain.push_back(view.gain);
    worth.push_back(view.worth);
    focal.push_back(static_cast<float>(view.camera.fx));
  }
  p.set("camera", std::span<const Eigen::Vector3f>(geometry.camera));
  p.set("gain", std::span<const float>(gain));
  p.set("worth", std::span<const float>(worth));
  p.set("focal", std::span<const float>(focal));
  gl::drawFullScreen(p, (*targets)->into);

  if (auto ok = (*targets)->color.download(std::span<std::uint8_t>(photo.color)); !ok)
    return tl::unexpected(ok.error());
  std::vector<std::uint8_t> source(texels * 4);
  if (auto ok = (*targets)->source.download(std::span<std::uint8_t>(source)); !ok)
    return tl::unexpected(ok.error());
  std::vector<float> detail(texels * 4);
  if (auto ok = (*targets)->detail.download(std::span<float>(detail)); !ok) return tl::unexpected(ok.error());
  for (std::size_t i = 0; i < texels; ++i) {
    if (source[4 * i] == 0) continue;
    photo.source[i] = static_cast<std::uint16_t>(source[4 * i] - 1);
    photo.seen_by[i] = source[4 * i + 1];
    photo.provisional[i] = source[4 * i + 2];
    photo.gsd_m[i] = detail[4 * i];
    photo.tilt[i] = detail[4 * i + 1];
  }
  return photo;
}

}  // namespace overfly::tiling
