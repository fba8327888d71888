#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "tiling/index/indexed_frame.h"
#include "tiling/planar/planar_image.h"
#include "tiling/tile.h"

namespace overfly::tiling {

// Which frame gives each texel of a tile on a plane, found without any pixels.
//
// A texel takes the frame that looks at it most steeply, that is with the smallest distance from the point
// below the camera per height above the plane, among the frames whose picture holds it; ties go to the lower
// id (the GRAPP paper leaves the choice open; this one is a function of the set of frames). Blocks of
// kBlock x kBlock texels whose four corners agree are taken whole.
//
// The way from texels into a picture is exact at the blocks' corners (lens and all) and bilinear between
// them: within 0.1 pixel for frames that look at most 35 degrees aside and blocks of at most a tenth of the
// height (test: TextureLiesWhereTheExactProjectionSays).
class PlanarPlan {
 public:
  static constexpr int kBlock = 16;
  static constexpr int kNone = -1, kMixed = -2;

  // `candidates`: the frames that may touch the tile, by ascending id; borrowed for the call. `size` is a
  // multiple of kBlock. `height_m`: of the plane, ellipsoidal.
  PlanarPlan(const geo::TileLattice& lattice, const geo::TileKey& key, int size, double height_m,
             std::span<const IndexedFrame* const> candidates);

  [[nodiscard]] const geo::TileKey& key() const { return key_; }
  // Ids of the frames that some texel needs, ascending: the tile's frame set.
  [[nodiscard]] const std::vector<std::uint64_t>& frames() const { return ids_; }

  // The tile: colour, kind (provisional: a plane is a guess), source and GSD; no heights.
  // `images`: those of frames(), in that order.
  [[nodiscard]] Tile render(std::span<const PlanarImagePtr> images) const;

  // What a tile was drawn from, block by block: a block whose mark is the same in two plans of one tile has
  // the same texels. 0: a block without any.
  using Marks = std::vector<std::uint64_t>;
  // How a tile that an earlier plan drew becomes what render() gives: prepare(), then draw() for each frame
  // that is needed, in any order, then finish(). Which frame gives a texel needs no pixels, and the colour
  // that a frame gives it depends on nothing else: so only texels that change their frame are read, nearly
  // always from the new one alone, and from one picture at a time.
  struct Changes {
    std::vector<bool> needed;           // of frames(): which pictures are read
    std::vector<std::uint16_t> source;  // of the texels of changed blocks that several frames share, in turn
  };
  // Brings the tile's frame set, and its sources with it, up to date.
  [[nodiscard]] Changes prepare(Tile& tile, const Marks& marks) const;
  // The texels that change to frames()[k], whose picture it is. True: some texel was drawn.
  bool draw(const Changes& changes, std::size_t k, const PlanarImage& image, const Marks& marks,
            Tile& tile) const;
  // Empties the texels that no frame gives any more; `marks` become this plan's.
  void finish(const Changes& changes, Tile& tile, Marks& marks) const;
  // A tile without any texel, in the memory of one that is no longer needed; and its marks.
  [[nodiscard]] Tile blank(Tile&& reuse = {}) const;
  [[nodiscard]] Marks noMarks() const { return Marks(winner_.size(), 0); }

 private:
  struct View {
    double gsd_m = 0;
    int width = 0, height = 0;  // of the full picture
    // At the blocks' corners, row by row: pixel of the full picture (NaN: none), distance^2 / height^2.
    std::vector<float> x, y, away;
  };
  [[nodiscard]] bool holds(const View& view, float x, float y) const;
  [[nodiscard]] int winnerAt(std::size_t node) const;
  struct Place;  // of a block
  class Lines;   // of a block's rows in a picture
  [[nodiscard]] Place placeOf(std::size_t block) const;
  [[nodiscard]] bool reaches(const View& view, const Place& place) const;
  void chooseTexels(const Place& place, std::uint16_t* source) const;
  void copyBlock(const Place& place, int view, const PlanarImage& image, Tile& tile) const;
  bool mixBlock(const Place& place, const std::uint16_t* source, std::size_t k, const PlanarImage& image,
                Tile& tile) const;

  geo::TileKey key_;
  int size_ = 0;
  int blocks_ = 0;  // along a side
  std::vector<View> views_;
  std::vector<std::uint64_t> ids_;
  std::vector<int> winner_;  // by block: index into views_, kNone or kMixed
  Marks marks_;              // by block
};

}  // namespace overfly::tiling
