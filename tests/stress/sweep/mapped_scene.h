#pragma once
// A small flight over a scene, through the whole Mapper: frames in, level-0 tiles out.
#include <map>
#include <set>

#include "tests/stress/sweep/placed_scene.h"
#include "tiling/mapping/mapper.h"

namespace overfly::test {

class MappedScene {
 public:
  // `columns` x `rows` cameras 60 m up, 9 x 8 m apart, over tiles of 64 texels of about 0.3 m.
  MappedScene(const Scene& scene, int columns, int rows)
      : local_(geo::TileFrame(lattice(), {kZoom, 0, 0}).local()) {
    for (int row = 0; row < rows; ++row)
      for (int column = 0; column < columns; ++column) {
        const Station station = straightDown(9.0 * (column - 0.5 * (columns - 1)),
                                             8.0 * (row - 0.5 * (rows - 1)), kUp + 0.1 * column);
        const PlacedPhoto placed = photograph(lookOf(scene), sceneCamera(220, kFocal), station);
        auto frame = std::make_shared<capture::Frame>();
        frame->sequence = frames_.size();
        frame->name = "frame" + std::to_string(frames_.size());
        frame->camera = placed.photo.camera;
        frame->pose = poseAt(station, local_, kHeight);
        frame->image = {capture::PixelFormat::Rgb8, 220, 220, 3 * 220, {}};
        for (std::size_t i = 0; i < placed.photo.luma.size(); ++i)
          frame->image.bytes.insert(frame->image.bytes.end(), 3, placed.photo.luma[i]);
        frames_.push_back(std::move(frame));
      }
  }

  [[nodiscard]] std::size_t size() const { return frames_.size(); }
  [[nodiscard]] const capture::FramePtr& frame(std::size_t i) const { return frames_.at(i); }
  [[nodiscard]] const geo::LocalFrame& local() const { return local_; }
  [[nodiscard]] static geo::TileLattice lattice() {
    return geo::TileLattice::local({geo::radians(47.38), geo::radians(8.54), 0});
  }
  static constexpr double kHeight = 455;

  // A mapper that has settled here.
  [[nodiscard]] static std::unique_ptr<tiling::Mapper> mapper(gl::Context& context,
                                                              tiling::MapperOptions options = {}) {
    options.tile_size = kTexels;
    auto made = tiling::Mapper::create(context, options);
    if (!made) throw std::runtime_error(made.error().message);
    tiling::MapGround ground;
    ground.lattice = lattice();
    ground.base_zoom = kZoom;
    ground.gsd_m = kPixel;
    ground.texel_m = lattice().texelSize(kZoom, geo::radians(47.38), geo::radians(8.54), kTexels);
    ground.height_m = kHeight;
    ground.min_height_m = kHeight - 12;
    ground.max_height_m = kHeight + 25;
    ground.anchor_px = 0;
    (*made)->setGround(ground);
    return std::move(*made);
  }
  [[nodiscard]] std::set<geo::TileKey> add(tiling::Mapper& mapper, std::size_t i) const {
    auto touched = mapper.addFrame(i, frames_.at(i),
                                   [frame = frames_.at(i)] { return Result<capture::FramePtr>(frame); });
    if (!touched) throw std::runtime_error(touched.error().message);
    return {touched->begin(), touched->end()};
  }
  // All tiles of these cells.
  [[nodiscard]] static std::map<geo::TileKey, tiling::Tile> finish(tiling::Mapper& mapper,
                                                                   const std::set<geo::TileKey>& cells) {
    std::map<geo::TileKey, tiling::Tile> tiles;
    for (const geo::TileKey& cell : cells) {
      auto made = mapper.finishCell(cell);
      if (!made) throw std::runtime_error(made.error().message);
      for (tiling::Tile& tile : *made) {
        const geo::TileKey key = tile.key;
        tiles.insert_or_assign(key, std::move(tile));
      }
    }
    return tiles;
  }

 private:
  geo::LocalFrame local_;
  std::vector<capture::FramePtr> frames_;
};

}  // namespace overfly::test
