#include "tiling/sweep/detail/hidden_views.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "render/gl/commands.h"
#include "sweep_shaders.h"
#include "tiling/sweep/height_filter.h"

namespace overfly::tiling::detail {

Result<gl::Program*> HiddenViews::programOf(int views, bool on_surface) {
  const std::pair key(views, on_surface);
  if (const auto found = programs_.find(key); found != programs_.end()) return &found->second;
  const std::array files{gl::ShaderFile{"hidden.glsl", shaders::sweep::hidden_glsl},
                         gl::ShaderFile{"hidden_views.frag", shaders::sweep::hidden_views_frag}};
  std::vector<gl::Define> defines = viewDefines(views);
  defines.push_back({"STRETCH", std::to_string(kCeilingBlock) + ".0"});
  if (on_surface) defines.push_back({"ON_SURFACE", "1"});
  auto program = on_surface ? gl::Program::fullScreen(*context_, files, defines)
                            : TexelBlocks::program(*context_, files, defines);
  if (!program) return tl::unexpected(program.error());
  return &programs_.emplace(key, std::move(*program)).first->second;
}

Result<gl::Texture*> HiddenViews::ceilingOf(const Occluder& occluder) {
  const int side = occluder.side();
  auto found = ceilings_.find(side);
  if (found == ceilings_.end()) {
    const int blocks = (side + kCeilingBlock - 1) / kCeilingBlock;
    auto made = gl::Texture::create(*context_, {.format = gl::Format::R32F,
                                                .width = blocks,
                                                .height = blocks,
                                                .sampling = {gl::Filter::Nearest, gl::Filter::Nearest}});
    if (!made) return tl::unexpected(made.error());
    found = ceilings_.emplace(side, std::move(*made)).first;
  }
  found->second.upload(std::span<const float>(tiling::ceilingOf(occluder.height, side)));
  return &found->second;
}

Result<void> HiddenViews::mark(const ViewGeometry& geometry, int grid_texels, int grid_apron,
                               const Occluder& occluder, const Base* base, const HidingRule& rule,
                               gl::Framebuffer& target) {
  auto program = programOf(static_cast<int>(geometry.camera.size()), base == nullptr);
  if (!program) return tl::unexpected(program.error());
  auto ceiling = ceilingOf(occluder);
  if (!ceiling) return tl::unexpected(ceiling.error());
  gl::Program& p = **program;
  setGrid(p, geometry, grid_texels, grid_apron);
  p.setTexture("surface", 0, *occluder.texture);
  p.setTexture("ceiling", 1, **ceiling);
  if (base != nullptr) {
    p.setTexture("base_height", 2, *base->height);
    p.set("height_offset", static_cast<float>(base->offset_m));
  } else {
    p.setTexture("own_height", 2, *occluder.own);
  }
  // A texel's centre (x + 0.5) of the grid lies at (x + 0.5 - grid_apron) * scale + apron of the surface.
  const double scale = static_cast<double>(occluder.texels) / grid_texels;
  p.set("surface_from_texel",
        Eigen::Vector2d(scale / occluder.side(), (occluder.apron - grid_apron * scale) / occluder.side())
            .cast<float>()
            .eval());
  Eigen::Matrix2d enu_from_st;  // metres per unit of s, t; the cell spans two units
  enu_from_st.col(0) = geometry.ground[1].head<2>().cast<double>();
  enu_from_st.col(1) = geometry.ground[2].head<2>().cast<double>();
  const Eigen::Matrix2d surface_from_enu = enu_from_st.inverse() * (0.5 * occluder.texels / occluder.side());
  p.set("surface_from_enu", Eigen::Vector4d(surface_from_enu(0, 0), surface_from_enu(1, 0),
                                            surface_from_enu(0, 1), surface_from_enu(1, 1))
                                .cast<float>()
                                .eval());
  p.set("camera", std::span<const Eigen::Vector3f>(geometry.camera));
  p.set("highest", *std::max_element(occluder.height.begin(), occluder.height.end()));
  p.set("march_step", static_cast<float>(2.0 * enu_from_st.col(0).norm() / occluder.texels));
  p.set("rim", static_cast<float>(rule.rim));
  p.set("clearance", static_cast<float>(rule.clearance_m));
  p.set("share", static_cast<float>(rule.share));
  if (base != nullptr)
    base->wanted->draw(p, target);
  else
    gl::drawFullScreen(p, target);
  return {};
}

}  // namespace overfly::tiling::detail
