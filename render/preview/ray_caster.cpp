#include "render/preview/ray_caster.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <utility>

#include "preview_shaders.h"
#include "render/gl/commands.h"

namespace overfly::preview {
namespace {

namespace text = overfly::shaders::preview;
using gl::ShaderFile;

constexpr ShaderFile kMap{"map.glsl", text::map_glsl};
constexpr ShaderFile kSurface{"surface.glsl", text::surface_glsl};
constexpr ShaderFile kTraverse{"traverse.glsl", text::traverse_glsl};
constexpr ShaderFile kColor{"color.glsl", text::color_glsl};
constexpr ShaderFile kShade{"shade.glsl", text::shade_glsl};
constexpr ShaderFile kLateral{"lateral.glsl", text::lateral_glsl};
constexpr ShaderFile kPreview{"preview.frag", text::preview_frag};
constexpr ShaderFile kRays{"rays.frag", text::rays_frag};

RayHit hitFrom(std::span<const std::uint32_t> where, std::span<const std::uint32_t> how,
               const RayFrame& frame) {
  RayHit hit;
  hit.found = (how[3] & 1U) != 0;
  hit.gave_up = (how[3] & 2U) != 0;
  hit.level = static_cast<int>(how[3] >> 2);
  hit.steps = static_cast<int>(how[2]);
  if (!hit.found) return hit;
  const auto value = [](std::uint32_t bits) { return static_cast<double>(std::bit_cast<float>(bits)); };
  hit.texel = {static_cast<std::int32_t>(where[0]) + value(where[2]),
               static_cast<std::int32_t>(where[1]) + value(where[3])};
  hit.height_m = value(how[0]) + frame.base_height_m;
  hit.t = value(how[1]);
  return hit;
}

// A float and what it cut off.
std::pair<float, float> twoFloats(double x) {
  const auto head = static_cast<float>(x);
  return {head, static_cast<float>(x - static_cast<double>(head))};
}

// As shaders/rays.frag reads them, 16 words a ray; the last ray is repeated up to `count`.
std::vector<std::uint32_t> packed(std::span<const SingleRay> rays, const RayFrame& frame, std::size_t count) {
  std::vector<std::uint32_t> out;
  out.reserve(16 * count);
  const auto bits = [](float x) { return std::bit_cast<std::uint32_t>(x); };
  for (std::size_t i = 0; i < count; ++i) {
    const SingleRay& ray = rays[std::min(i, rays.size() - 1)];
    const Eigen::Vector3d start = frame.start + ray.start, along = frame.per_metre * ray.direction;
    std::array<std::uint32_t, 16> words{};
    for (std::size_t k = 0; k < 2; ++k) {
      const double whole = std::floor(start[static_cast<Eigen::Index>(k)]);
      words[k] =
          static_cast<std::uint32_t>(frame.cell[static_cast<Eigen::Index>(k)] + static_cast<int>(whole));
      words[2 + k] = bits(static_cast<float>(start[static_cast<Eigen::Index>(k)] - whole));
    }
    for (std::size_t k = 0; k < 4; ++k) {
      const auto [head, rest] = twoFloats(k < 3 ? along[static_cast<Eigen::Index>(k)] : start.z());
      words[4 + k] = bits(head);
      words[8 + k] = bits(rest);
      if (k < 3) words[12 + k] = bits(static_cast<float>(ray.direction.dot(frame.bend[k] * ray.direction)));
    }
    words[15] = bits(static_cast<float>(ray.levels_per_metre));
    out.insert(out.end(), words.begin(), words.end());
  }
  return out;
}

}  // namespace

Result<gl::Program*> RayCaster::program(const std::string& fragment, const std::vector<gl::Define>& defines) {
  std::string name = fragment;
  for (const gl::Define& define : defines) name += " " + define.name + "=" + define.value;
  const auto found = programs_.find(name);
  if (found != programs_.end()) return &found->second;
  std::vector<ShaderFile> files{kMap, kSurface, kTraverse};
  if (fragment == kRays.name) {
    files.push_back(kRays);
  } else {
    files.insert(files.end(), {kColor, kShade, kLateral, kPreview});
  }
  auto made = gl::Program::fullScreen(*context_, files, defines);
  if (!made) return tl::unexpected(made.error());
  return &programs_.emplace(name, std::move(*made)).first->second;
}

Result<RayCaster::Targets*> RayCaster::targets(int width, int height, bool color, bool hits) {
  const std::string name = fmt::format("{}x{} {} {}", width, height, color, hits);
  const auto found = targets_.find(name);
  if (found != targets_.end()) return &found->second;
  if (targets_.size() >= 4) targets_.clear();  // sizes that are no longer asked for
  Targets out;
  const auto make = [&](gl::Texture& texture, gl::Format format) -> Result<void> {
    gl::TextureSpec spec;
    spec.format = format;
    spec.width = width;
    spec.height = height;
    spec.sampling = {gl::Filter::Nearest, gl::Filter::Nearest, false, gl::Wrap::Clamp};
    auto made = gl::Texture::create(*context_, spec);
    if (!made) return tl::unexpected(made.error());
    texture = std::move(*made);
    return {};
  };
  if (color) {
    if (auto made = make(out.color, gl::Format::RGBA8); !made) return tl::unexpected(made.error());
  }
  if (hits) {
    // Integers: floats in render targets are not promised by OpenGL ES 3.1.
    if (auto made = make(out.where, gl::Format::RGBA32UI); !made) return tl::unexpected(made.error());
    if (auto made = make(out.how, gl::Format::RGBA32UI); !made) return tl::unexpected(made.error());
  }
  Targets& kept = targets_.emplace(name, std::move(out)).first->second;
  std::vector<gl::Attachment> attachments;
  if (color) attachments.push_back({&kept.color, 0, 0});
  if (hits) {
    attachments.push_back({&kept.where, 0, 0});
    attachments.push_back({&kept.how, 0, 0});
  }
  auto framebuffer = gl::Framebuffer::create(*context_, attachments);
  if (!framebuffer) {
    targets_.erase(name);
    return tl::unexpected(framebuffer.error());
  }
  kept.framebuffer = std::move(*framebuffer);
  return &kept;
}

void RayCaster::setFrame(gl::Program& program, const RayFrame& frame, const ClipCache& cache, double length_m,
                         const Chords& chords) {
  program.set("origin_cell", frame.cell);
  program.set("lowest", static_cast<float>(cache.lowest() - frame.base_height_m - kWallFoot));
  program.set("highest", static_cast<float>(cache.highest() - frame.base_height_m + 0.01));
  program.set("chord_metres", static_cast<float>(chords.metres));
  program.set("chord_growth", static_cast<float>(chords.growth));
  // No ray looks at more cells than all that lie along both sides of the finest level, each level's once on
  // the way down and once up, and the chords.
  program.set("max_steps", 8 * cache.domain().texelsAcross(0) + 4096);
  program.set("max_distance", static_cast<float>(length_m));
}

Result<RayCaster::Targets*> RayCaster::render(const View& view, const RayFrame& frame, const Look& look,
                                              const ClipCache& cache, const MapTextures& textures,
                                              bool hits) {
  std::vector<gl::Define> defines = textures.defines();
  defines.push_back({"SURFACE", std::to_string(static_cast<int>(look.surface))});
  defines.push_back({"FILTER", std::to_string(static_cast<int>(look.filter))});
  defines.push_back({"MODE", std::to_string(static_cast<int>(look.mode))});
  defines.push_back({"SHADOWS", look.shadows ? "1" : "0"});
  defines.push_back({"PATCH", look.no_data == NoData::Patch ? "1" : "0"});
  const bool project = projectors_ != nullptr && look.projectors > 0 && look.mode == Mode::Color;
  const int projectors = project ? projectors_->count() : 0;
  defines.push_back({"PROJECTORS", std::to_string(projectors)});
  defines.push_back({"PYRAMID", pyramid_ ? "1" : "0"});
  if (hits) defines.push_back({"HITS"});
  auto made = program(std::string(kPreview.name), defines);
  if (!made) return tl::unexpected(made.error());
  gl::Program& p = **made;
  auto target = targets(view.width, view.height, true, hits);
  if (!target) return tl::unexpected(target.error());
  textures.bind(p);
  setFrame(p, frame, cache, 2e6, look.level_of_detail ? kPictureChords : kExactChords);
  p.set("per_metre", Eigen::Matrix3f(frame.per_metre.cast<float>()));
  p.set("bend_x", Eigen::Matrix3f(frame.bend[0].cast<float>()));
  p.set("bend_y", Eigen::Matrix3f(frame.bend[1].cast<float>()));
  p.set("bend_z", Eigen::Matrix3f(frame.bend[2].cast<float>()));
  p.set("start", Eigen::Vector2f(frame.start.head<2>().cast<float>()));
  const auto [height, height_rest] = twoFloats(frame.start.z());
  p.set("start_height", Eigen::Vector2f(height, height_rest));
  p.set("enu_from_camera", Eigen::Matrix3f(view.enuFromCamera().cast<float>()));
  p.set("camera", Eigen::Vector3f(static_cast<float>(view.focal()), 0.5F * static_cast<float>(view.width),
                                  0.5F * static_cast<float>(view.height)));
  p.set("lod_per_metre",
        look.level_of_detail ? static_cast<float>(levelsPerMetre(view, cache.domain())) : 0.0F);
  p.set("max_anisotropy", static_cast<float>(look.max_anisotropy));
  p.set("texel_metres", static_cast<float>(cache.domain().texelSize()));
  p.set("relief", static_cast<float>(look.relief));
  p.set("sun", Eigen::Vector3f(static_cast<float>(std::sin(look.sun_heading) * std::cos(look.sun_height)),
                               static_cast<float>(std::cos(look.sun_heading) * std::cos(look.sun_height)),
                               static_cast<float>(std::sin(look.sun_height))));
  p.set("value_range", Eigen::Vector2f(static_cast<float>(cache.lowest() - frame.base_height_m),
                                       static_cast<float>(cache.highest() - frame.base_height_m)));
  if (projectors > 0) {
    projectors_->bind(p, MapTextures::kUnits, view);
    p.set("grazing", static_cast<float>(std::sin(look.projector_grazing)));
    constexpr double kBlend = 0.2;  // radians between the least steep side and one without the orthophoto
    p.set("lateral", look.lateral_slope > 0
                         ? Eigen::Vector2f(static_cast<float>(std::cos(look.lateral_slope)),
                                           static_cast<float>(std::cos(look.lateral_slope + kBlend)))
                         : Eigen::Vector2f(3, 2));  // every normal's height is less
  }
  p.set("sky_low", Eigen::Vector3f(0.80F, 0.87F, 0.93F));
  p.set("sky_high", Eigen::Vector3f(0.36F, 0.56F, 0.80F));
  p.set("nothing", Eigen::Vector3f(0.22F, 0.24F, 0.27F));
  gl::drawFullScreen(p, (*target)->framebuffer);
  return target;
}

Result<void> RayCaster::drawOnly(const View& view, const RayFrame& frame, const Look& look,
                                 const ClipCache& cache, const MapTextures& textures) {
  auto target = render(view, frame, look, cache, textures, false);
  if (!target) return tl::unexpected(target.error());
  context_->finish();
  return context_->check();
}

Result<Picture> RayCaster::draw(const View& view, const RayFrame& frame, const Look& look,
                                const ClipCache& cache, const MapTextures& textures, bool hits) {
  auto target = render(view, frame, look, cache, textures, hits);
  if (!target) return tl::unexpected(target.error());
  const auto pixels = static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height);
  Picture picture{view.width, view.height, std::vector<std::uint8_t>(4 * pixels), {}};
  if (auto read = (*target)->color.download(std::span<std::uint8_t>(picture.rgba)); !read)
    return tl::unexpected(read.error());
  if (hits) {
    std::vector<std::uint32_t> where(4 * pixels), how(4 * pixels);
    if (auto read = (*target)->where.download(std::span<std::uint32_t>(where)); !read)
      return tl::unexpected(read.error());
    if (auto read = (*target)->how.download(std::span<std::uint32_t>(how)); !read)
      return tl::unexpected(read.error());
    picture.hits.reserve(pixels);
    for (std::size_t i = 0; i < pixels; ++i)
      picture.hits.push_back(hitFrom({&where[4 * i], 4}, {&how[4 * i], 4}, frame));
  }
  if (auto fine = context_->check(); !fine) return tl::unexpected(fine.error());
  return picture;
}

Result<std::vector<RayHit>> RayCaster::cast(std::span<const SingleRay> rays, const RayFrame& frame,
                                            Surface surface, double length_m, const ClipCache& cache,
                                            const MapTextures& textures) {
  if (rays.empty()) return std::vector<RayHit>{};
  constexpr int kWidth = 512;  // of four texels each: 2048 is what OpenGL ES 3.1 promises
  const int height = static_cast<int>((rays.size() + kWidth - 1) / kWidth);
  std::vector<gl::Define> defines = textures.defines();
  defines.push_back({"SURFACE", std::to_string(static_cast<int>(surface))});
  defines.push_back({"PYRAMID", pyramid_ ? "1" : "0"});
  auto made = program(std::string(kRays.name), defines);
  if (!made) return tl::unexpected(made.error());
  gl::Program& p = **made;
  const std::size_t texels = static_cast<std::size_t>(kWidth) * static_cast<std::size_t>(height);
  gl::TextureSpec spec;
  spec.format = gl::Format::RGBA32UI;
  spec.width = 4 * kWidth;
  spec.height = height;
  spec.sampling = {gl::Filter::Nearest, gl::Filter::Nearest, false, gl::Wrap::Clamp};
  auto input = gl::Texture::create(*context_, spec);
  if (!input) return tl::unexpected(input.error());
  input->upload(std::span<const std::uint32_t>(packed(rays, frame, texels)));
  auto target = targets(kWidth, height, false, true);
  if (!target) return tl::unexpected(target.error());
  textures.bind(p);
  setFrame(p, frame, cache, length_m, kExactChords);
  p.setTexture("rays", MapTextures::kUnits, *input);
  gl::drawFullScreen(p, (*target)->framebuffer);
  std::vector<std::uint32_t> where(4 * texels), how(4 * texels);
  if (auto read = (*target)->where.download(std::span<std::uint32_t>(where)); !read)
    return tl::unexpected(read.error());
  if (auto read = (*target)->how.download(std::span<std::uint32_t>(how)); !read)
    return tl::unexpected(read.error());
  std::vector<RayHit> out;
  out.reserve(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i)
    out.push_back(hitFrom({&where[4 * i], 4}, {&how[4 * i], 4}, frame));
  if (auto fine = context_->check(); !fine) return tl::unexpected(fine.error());
  return out;
}

}  // namespace overfly::preview
