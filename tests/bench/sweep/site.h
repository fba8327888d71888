#pragma once
#include <memory>
#include <string>
#include <vector>

#include "capture/record/flight.h"
#include "tiling/accuracy/accuracy.h"
#include "tiling/mapping/mapper.h"
#include "tiling/rectify/frame_cache.h"
#include "tiling/sweep/match_image.h"

namespace overfly::bench {

// A recorded flight on the GPU, with the points that its heights are judged by. Errors end the program.
class Site {
 public:
  Site(gl::Context& context, const std::string& folder);

  struct Cell {
    geo::TileKey key;
    std::vector<tiling::ReferencePoint> points;  // inside, the strong ones
    std::vector<std::uint64_t> views;            // by view selection, best first
  };
  // Those with at least `min_points` strong points and `min_views` views, by key.
  [[nodiscard]] std::vector<Cell> cells(std::size_t min_points, std::size_t min_views) const;

  struct Views {
    std::vector<tiling::RectifiedPtr> frames;
    std::vector<gl::Texture> match;
    std::vector<tiling::SweepView> on_match, on_luma;
  };
  // The first `count` views of a cell.
  [[nodiscard]] Views viewsOf(const Cell& cell, std::size_t count) const;
  // Loaded and rectified anew: the cost of a frame's first use.
  [[nodiscard]] tiling::RectifyTimes uploadTimes(const Cell& cell, std::size_t count) const;
  [[nodiscard]] tiling::SweepGrid grid(const geo::TileFrame& frame, int texels) const;
  // Errors of a field against the cell's points, in GSD; NaN where there is no height.
  [[nodiscard]] std::vector<double> errors(const Cell& cell, const tiling::HeightField& field) const;
  [[nodiscard]] const tiling::MapGround& ground() const { return ground_; }
  [[nodiscard]] geo::TileFrame frameOf(const Cell& cell) const { return {ground_.lattice, cell.key}; }

 private:
  gl::Context* context_;
  capture::Flight flight_;
  tiling::MapGround ground_;
  std::vector<tiling::ReferencePoint> points_;
  std::unique_ptr<tiling::Mapper> mapper_;
  std::unique_ptr<tiling::FrameCache> cache_;
  std::unique_ptr<tiling::MatchImageMaker> matcher_;
};

// Median and normalised median deviation of the finite errors, and how many there are.
struct Summary {
  double median = 0, nmad = 0;
  std::size_t measured = 0;
};
[[nodiscard]] Summary summarise(const std::vector<double>& errors);

template <typename T>
T need(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}

// CPU time of this process over all its threads, seconds.
[[nodiscard]] double cpuSeconds();

}  // namespace overfly::bench
