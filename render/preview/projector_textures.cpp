#include "render/preview/projector_textures.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace overfly::preview {
namespace {

// Filtered colours must not be darkened by what lies beyond the photograph's border.
std::vector<std::uint8_t> premultiplied(std::vector<std::uint8_t> rgba) {
  for (std::size_t i = 0; i + 3 < rgba.size(); i += 4)
    for (std::size_t c = 0; c < 3; ++c)
      rgba[i + c] = static_cast<std::uint8_t>((rgba[i + c] * rgba[i + 3] + 127) / 255);
  return rgba;
}

}  // namespace

Result<ProjectorTextures> ProjectorTextures::create(gl::Context& context, const Options& options) {
  gl::TextureSpec spec;
  spec.format = gl::Format::RGBA8;
  spec.width = options.width;
  spec.height = options.height;
  spec.layers = kMost;
  spec.levels = gl::kFullChain;
  spec.sampling = {gl::Filter::Linear, gl::Filter::Linear, true, gl::Wrap::Clamp};
  auto images = gl::Texture::create(context, spec);
  if (!images) return tl::unexpected(images.error());
  ProjectorTextures out;
  out.images_ = std::move(*images);
  return out;
}

int ProjectorTextures::update(ProjectorSource& source, std::span<const Projector> chosen, int loads) {
  chosen = chosen.first(std::min<std::size_t>(chosen.size(), kMost));
  for (auto& slot : slots_)
    if (slot) slot->shown = false;
  std::vector<const Projector*> missing;
  for (const Projector& projector : chosen) {
    const auto there = std::find_if(slots_.begin(), slots_.end(), [&projector](const auto& slot) {
      return slot && slot->projector.id == projector.id;
    });
    if (there == slots_.end()) {
      missing.push_back(&projector);
    } else {
      (*there)->projector = projector;  // its pose may have been corrected
      (*there)->shown = true;
    }
  }
  int left = 0;
  bool changed = false;
  for (const Projector* projector : missing) {
    if (loads <= 0) {
      ++left;
      continue;
    }
    auto image = source.load(projector->id, images_.width(), images_.height());
    if (!image && image.error().code == ErrorCode::Unavailable) {
      ++left;
      continue;
    }
    --loads;
    if (!image) continue;
    // Of as many places as there may be photographs one that is not shown is left. Empty ones first: what two
    // views show in turn stays.
    auto place = std::find_if(slots_.begin(), slots_.end(), [](const auto& slot) { return !slot; });
    if (place == slots_.end())
      place = std::find_if(slots_.begin(), slots_.end(), [](const auto& slot) { return !slot->shown; });
    const std::vector<std::uint8_t> texels = premultiplied(std::move(image->rgba));
    images_.upload(std::span<const std::uint8_t>(texels), 0, static_cast<int>(place - slots_.begin()));
    *place = Slot{*projector, image->pinhole, true};
    changed = true;
  }
  if (changed) images_.generateMips();
  return left;
}

int ProjectorTextures::count() const {
  return static_cast<int>(
      std::count_if(slots_.begin(), slots_.end(), [](const auto& slot) { return slot && slot->shown; }));
}

void ProjectorTextures::bind(gl::Program& program, int unit, const View& view) const {
  const geo::LocalFrame frame(view.position);
  std::vector<Eigen::Matrix<float, 3, 4>> projectors;
  std::vector<float> details, layers;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (!slots_[i] || !slots_[i]->shown) continue;
    const Projector& projector = slots_[i]->projector;
    const capture::CameraModel& lens = slots_[i]->pinhole;
    Eigen::Matrix3d image_from_camera;
    image_from_camera << lens.fx / lens.width, 0, lens.cx / lens.width, 0, lens.fy / lens.height,
        lens.cy / lens.height, 0, 0, 1;
    const Eigen::Matrix3d enu_from_camera =
        frame.enuFromEcefRotation() * projector.ecef_from_camera.normalized().toRotationMatrix();
    Eigen::Matrix<float, 3, 4> m;
    m.leftCols<3>() = (image_from_camera * enu_from_camera.transpose()).cast<float>();
    m.col(3) = frame.enuFromEcef(projector.position_in_ecef).cast<float>();
    projectors.push_back(m);
    details.push_back(static_cast<float>(std::sqrt(lens.fx * lens.fy) / view.focal()));
    layers.push_back(static_cast<float>(i));
  }
  program.setTexture("projector_images", unit, images_);
  program.set("projector", std::span<const Eigen::Matrix<float, 3, 4>>(projectors));
  program.set("projector_detail", std::span<const float>(details));
  program.set("projector_layer", std::span<const float>(layers));
}

}  // namespace overfly::preview
