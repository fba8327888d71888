#pragma once
// The analytic scene as the mapper takes it: frames with pixels, and the one cell they are over.
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "capture/frame.h"
#include "tests/unit/sweep/analytic_scene.h"
#include "tiling/mapping/mapper.h"

namespace overfly::test {

inline constexpr int kTile = 128;  // texels of 0.2 m: the scene's cell
inline constexpr int kZoom = 20;

inline capture::FramePtr frameOf(std::uint64_t id, const Photo& photo, double time_s) {
  auto frame = std::make_shared<capture::Frame>();
  frame->sequence = id;
  frame->name = std::to_string(id);
  frame->time_ns = static_cast<std::int64_t>(time_s * 1e9);
  frame->camera = photo.camera;
  frame->pose = photo.pose;
  frame->image.format = capture::PixelFormat::Rgb8;
  frame->image.width = photo.camera.width;
  frame->image.height = photo.camera.height;
  frame->image.stride = 3 * photo.camera.width;
  for (std::size_t i = 0; i < photo.rgba.size(); i += 4)
    for (std::size_t c = 0; c < 3; ++c) frame->image.bytes.push_back(photo.rgba[i + c]);
  return frame;
}

// Twelve frames, 4 x 3, over the cell: ground of 0.2 m per pixel.
inline std::vector<Photo> photograph(const Scene& scene, double shift_m) {
  std::vector<Photo> photos;
  for (int i = 0; i < 12; ++i)
    photos.push_back(takePhoto(
        scene, sceneCamera(200, kFlight / 0.2),
        lookDown(8.0 * (i % 4) - 12 + shift_m, 9.0 * (i / 4) - 9 - shift_m, kGround + kFlight + 0.2 * i)));
  return photos;
}

inline std::unique_ptr<tiling::Mapper> sceneMapper(gl::Context& context, tiling::MapperOptions options = {}) {
  options.tile_size = kTile;
  auto made = tiling::Mapper::create(context, options);
  if (!made) throw std::runtime_error(made.error().message);
  tiling::MapGround ground;
  ground.base_zoom = kZoom;
  ground.gsd_m = 0.2;
  ground.texel_m = 0.204;
  ground.height_m = kGround;
  ground.min_height_m = kGround - 10;
  ground.max_height_m = kGround + 20;
  ground.anchor_px = geo::TileLattice::planeOf(sceneFrame().key(), 0.5, 0.5).x();
  (*made)->setGround(ground);
  return std::move(*made);
}

inline void add(tiling::Mapper& mapper, const capture::FramePtr& frame) {
  auto touched =
      mapper.addFrame(frame->sequence, frame, [frame]() -> Result<capture::FramePtr> { return frame; });
  if (!touched) throw std::runtime_error(touched.error().message);
}

inline tiling::Tile finish(tiling::Mapper& mapper,
                           tiling::Mapper::Around around = tiling::Mapper::Around::Current) {
  auto tiles = mapper.finishCell(sceneFrame().key(), around);
  if (!tiles) throw std::runtime_error(tiles.error().message);
  if (tiles->size() != 1) throw std::runtime_error("not one tile");
  return std::move(tiles->front());
}

}  // namespace overfly::test
