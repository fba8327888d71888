#pragma once
#include <stdexcept>
#include <vector>

#include "render/gl/context.h"
#include "tests/unit/sweep/analytic_scene.h"
#include "tiling/sweep/match_image.h"
#include "tiling/sweep/orthophoto.h"
#include "tiling/sweep/sweep.h"

namespace overfly::test {

// Photographs on the GPU as the sweep and the orthophoto want them. Thread-bound to the context's thread.
class GpuPhotos {
 public:
  GpuPhotos(gl::Context& context, const std::vector<Photo>& photos) {
    auto maker = take(tiling::MatchImageMaker::create(context));
    photos_.reserve(photos.size());
    for (const Photo& photo : photos) {
      Entry entry;
      const auto texture = [&](gl::Format format, int levels) {
        return take(gl::Texture::create(context, {.format = format,
                                                  .width = photo.camera.width,
                                                  .height = photo.camera.height,
                                                  .levels = levels}));
      };
      entry.color = texture(gl::Format::RGBA8, 1);
      entry.color.upload(std::span<const std::uint8_t>(photo.rgba));
      entry.luma = texture(gl::Format::R8, gl::kFullChain);
      entry.luma.upload(std::span<const std::uint8_t>(photo.luma));
      entry.luma.generateMips();
      entry.match = take(maker->make(entry.luma, entry.color));
      entry.camera = photo.camera;
      entry.pose = photo.pose;
      photos_.push_back(std::move(entry));
    }
  }

  // Views on the match images, or (for the costs that want it) on the luminance.
  [[nodiscard]] std::vector<tiling::SweepView> sweepViews(bool luma = false) const {
    std::vector<tiling::SweepView> views;
    for (const Entry& entry : photos_)
      views.push_back({views.size(), luma ? &entry.luma : &entry.match, entry.camera, entry.pose});
    return views;
  }
  [[nodiscard]] std::vector<tiling::OrthoView> orthoViews() const {
    std::vector<tiling::OrthoView> views;
    for (const Entry& entry : photos_)
      views.push_back({views.size(), &entry.color, entry.camera, entry.pose, 1, 1});
    return views;
  }

 private:
  struct Entry {
    gl::Texture color, luma, match;
    capture::CameraModel camera;
    capture::Pose pose;
  };
  template <typename T>
  static T take(Result<T> result) {
    if (!result) throw std::runtime_error(result.error().message);
    return std::move(*result);
  }
  std::vector<Entry> photos_;
};

inline tiling::SweepGrid sceneGrid() { return {&sceneFrame(), 256, 16, kGround, kGround - 12, kGround + 25}; }

// Place (east, north) of a texel of a grid with an apron.
inline Eigen::Vector2d placeOf(int x, int y, int texels, int apron) {
  return sceneFrame()
      .enuFromTexelExact((x - apron + 0.5) / texels, (y - apron + 0.5) / texels, kGround)
      .head<2>();
}

}  // namespace overfly::test
