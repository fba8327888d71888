#include "daemon/tradeoff/preview_trials.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "render/preview/previewer.h"
#include "tiling/preview/store_tile_source.h"
#include "tiling/pyramid/map_writer.h"
#include "tiling/pyramid/pyramid.h"

namespace overfly::tradeoff {
namespace {

using preview::Filter;
using preview::Look;
using preview::Picture;
using preview::Surface;
using preview::View;

constexpr double kPitch = -0.7, kFov = 1.0471975512;  // radians

// The tiles as a map on disk with all its levels, as the preview has them.
Result<std::unique_ptr<tiling::StoreTileSource>> sourceOf(const std::map<geo::TileKey, tiling::Tile>& tiles,
                                                          const tiling::MapGround& ground, int tile_size,
                                                          const std::filesystem::path& file) {
  tiling::MapMeta meta;
  meta.lattice = ground.lattice.text();
  meta.base_zoom = ground.base_zoom;
  meta.tile_size = tile_size;
  auto store = tiling::MapStore::create(file, meta);
  if (!store) return tl::unexpected(store.error());
  tiling::MapWriter writer(*store);
  for (const auto& [key, tile] : tiles)
    if (auto added = writer.add(tile); !added) return tl::unexpected(added.error());
  if (auto written = writer.flush(); !written) return tl::unexpected(written.error());
  if (auto made = tiling::makePyramid(*store); !made) return tl::unexpected(made.error());
  return tiling::StoreTileSource::open(file);
}

// The middle of the map from the south, near enough that level 0 is what a pixel shows in the foreground.
Result<View> obliqueView(const preview::MapExtent& extent, double ground_m, int width) {
  auto domain = preview::Domain::create(extent);
  if (!domain) return tl::unexpected(domain.error());
  View view;
  view.fov = kFov;
  view.pitch = kPitch;
  view.width = width;
  view.height = width * 9 / 16;
  const double across = (domain->maxTexel() - domain->minTexel()).minCoeff() * domain->texelSize();
  const double away = 0.5 * across / std::tan(kFov / 2);
  const Eigen::Vector2d middle = (domain->minTexel() + domain->maxTexel()) / 2;
  const double south = away * std::cos(kPitch) / domain->texelSize();
  view.position =
      domain->lattice().geodeticFromPlane(domain->planeFromTexel(middle + Eigen::Vector2d(0, south)));
  view.position.height_m = ground_m + away * std::sin(-kPitch);
  return view;
}

// At the size of the reference: averaged down, or each pixel repeated, which any viewer can do.
cv::Mat resized(const Picture& picture, int width, int height) {
  const cv::Mat rgba(picture.height, picture.width, CV_8UC4, const_cast<std::uint8_t*>(picture.rgba.data()));
  cv::Mat rgb, out;
  cv::cvtColor(rgba, rgb, cv::COLOR_RGBA2RGB);
  cv::resize(rgb, out, {width, height}, 0, 0, picture.width > width ? cv::INTER_AREA : cv::INTER_NEAREST);
  return out;
}

double meanDifference(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_L1) /
         static_cast<double>(a.total() * static_cast<std::size_t>(a.channels()));
}

struct Setting {
  std::string axis, text;
  bool is_default = false;
  Look look;
  int divisor = 1;  // of the picture's resolution
};

std::vector<Setting> settings() {
  std::vector<Setting> list;
  const auto add = [&](const std::string& axis, const std::string& text,
                       const std::function<void(Setting&)>& change) {
    Setting setting{axis, text, axis == "default", {}, 1};
    change(setting);
    list.push_back(std::move(setting));
  };
  add("default", "linear surface, 4 anisotropic samples", [](Setting&) {});
  add("surface", "blocks", [](Setting& s) { s.look.surface = Surface::Blocks; });
  add("surface", "bicubic surface", [](Setting& s) { s.look.surface = Surface::Bicubic; });
  add("filter", "nearest texel", [](Setting& s) { s.look.filter = Filter::Nearest; });
  add("filter", "bilinear", [](Setting& s) { s.look.filter = Filter::Bilinear; });
  add("filter", "trilinear", [](Setting& s) { s.look.filter = Filter::Trilinear; });
  for (const int samples : {1, 2, 8, 16})
    add("samples", fmt::format("{} anisotropic samples", samples),
        [samples](Setting& s) { s.look.max_anisotropy = samples; });
  add("level of detail", "finest level everywhere", [](Setting& s) { s.look.level_of_detail = false; });
  for (const int divisor : {2, 4})
    add("resolution", fmt::format("resolution 1/{}", divisor),
        [divisor](Setting& s) { s.divisor = divisor; });
  add("combined", "blocks, nearest texel, resolution 1/4", [](Setting& s) {
    s.look.surface = Surface::Blocks;
    s.look.filter = Filter::Nearest;
    s.divisor = 4;
  });
  add("combined", "bicubic, 16 samples, finest level", [](Setting& s) {
    s.look.surface = Surface::Bicubic;
    s.look.max_anisotropy = 16;
    s.look.level_of_detail = false;
  });
  return list;
}

}  // namespace

Result<std::vector<Trial>> tryPreview(gl::Context& context, const std::map<geo::TileKey, tiling::Tile>& tiles,
                                      const tiling::MapGround& ground, int tile_size,
                                      const std::filesystem::path& scratch, int width, int repeats) {
  if (tiles.empty()) return fail(ErrorCode::BadInput, "no tile to draw");
  auto source = sourceOf(tiles, ground, tile_size, scratch);
  if (!source) return tl::unexpected(source.error());
  preview::RamCache ram(**source, {.budget_bytes = std::size_t{1} << 30});
  preview::Previewer previewer(context, ram, {.gpu_bytes = std::size_t{512} << 20});
  const auto extent = (*source)->extent();
  if (!extent) return tl::unexpected(extent.error());
  auto view = obliqueView(*extent, ground.height_m, width);
  if (!view) return tl::unexpected(view.error());

  Look best;
  best.surface = Surface::Bicubic;
  best.max_anisotropy = 16;
  best.level_of_detail = false;
  View doubled = *view;
  doubled.width *= 2;
  doubled.height *= 2;
  auto drawn = previewer.drawSettled(doubled, best);
  if (!drawn) return tl::unexpected(drawn.error());
  const cv::Mat reference = resized(drawn->picture, view->width, view->height);

  std::vector<Trial> trials;
  for (const Setting& setting : settings()) {
    View at = *view;
    at.width /= setting.divisor;
    at.height /= setting.divisor;
    Trial trial{.part = "preview",
                .axis = setting.axis,
                .setting = setting.text,
                .is_default = setting.is_default,
                .error_name = "mean difference, 0 to 255"};
    std::vector<double> processor, wall;
    for (int run = 0; run <= repeats; ++run) {  // the first compiles the shader and loads the tiles
      const Elapsed elapsed = elapsedOf([&] { drawn = previewer.drawSettled(at, setting.look); });
      if (!drawn) return tl::unexpected(drawn.error());
      if (run == 0) continue;
      processor.push_back(elapsed.processor_ms);
      wall.push_back(elapsed.wall_ms);
    }
    trial.processor = timingOf(processor);
    trial.wall = timingOf(wall);
    trial.error = meanDifference(resized(drawn->picture, view->width, view->height), reference);
    trials.push_back(std::move(trial));
  }
  markFront(trials);
  return trials;
}

}  // namespace overfly::tradeoff
