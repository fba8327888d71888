#include "tiling/mapping/mapper.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <list>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "capture/geo/tile_frame.h"
#include "tiling/mapping/exposure_balance.h"
#include "tiling/mapping/ground_estimate.h"
#include "tiling/mapping/guess_surface.h"
#include "tiling/mapping/height_mosaic.h"
#include "tiling/rectify/frame_cache.h"
#include "tiling/sweep/height_filter.h"
#include "tiling/sweep/orthophoto.h"

namespace overfly::tiling {
namespace {

constexpr int kSurfaceMargin = 96;  // sweep texels around a cell in which occluders are looked for
constexpr int kThumbnailLevel = 3;
constexpr double kFinerThanFrames = 0.9;  // texels of the sweep are not smaller, in GSD of the frames

// Adds the time of its life to a total, and the processor time of all threads to another.
class Stopwatch {
 public:
  explicit Stopwatch(double& total, double* processor = nullptr)
      : total_(total),
        processor_(processor),
        start_(std::chrono::steady_clock::now()),
        processor_start_(std::clock()) {}
  ~Stopwatch() {
    total_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    if (processor_ != nullptr)
      *processor_ += static_cast<double>(std::clock() - processor_start_) / CLOCKS_PER_SEC;
  }
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

 private:
  double& total_;
  double* processor_;
  std::chrono::steady_clock::time_point start_;
  std::clock_t processor_start_;
};

// A cell as it was last swept.
struct SweptCell {
  HeightField field;
  std::vector<std::uint64_t> views;  // in the order of their choice
  std::vector<capture::Pose> poses;  // at that time
  SweepOptions options;
  int coarser = 0;  // see coarserThanCell()
  std::uint64_t last_use = 0;
};

// How many times half the cell's resolution is as much as its frames have: a map's place is settled by its
// first frames, and others may be flown higher.
int coarserThanCell(std::span<const SelectedView> views, double cell_texel_m, double working_scale) {
  std::vector<double> gsd_m;
  for (const SelectedView& view : views) gsd_m.push_back(view.gsd_m);
  if (gsd_m.empty()) return 0;
  const auto middle = gsd_m.begin() + static_cast<std::ptrdiff_t>(gsd_m.size() / 2);
  std::nth_element(gsd_m.begin(), middle, gsd_m.end());
  int coarser = 0;
  while (cell_texel_m * (1 << coarser) < kFinerThanFrames * *middle / working_scale) ++coarser;
  return coarser;
}

bool samePose(const capture::Pose& a, const capture::Pose& b) {
  return a.position_in_ecef == b.position_in_ecef &&
         a.ecef_from_camera.coeffs() == b.ecef_from_camera.coeffs();
}

bool inPolygon(const std::array<Eigen::Vector2d, 4>& polygon, const Eigen::Vector2d& point) {
  int positive = 0, negative = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d side = polygon[(i + 1) % 4] - polygon[i], to = point - polygon[i];
    const double cross = side.x() * to.y() - side.y() * to.x();
    (cross > 0 ? positive : negative) += 1;
  }
  return positive == 0 || negative == 0;
}

}  // namespace

struct Mapper::Impl {
  gl::Context* context = nullptr;
  MapperOptions options;
  MapGround ground;
  int scale = 0;  // the working scale in force
  std::unique_ptr<FrameIndex> index;
  std::unique_ptr<FrameCache> cache;
  std::unique_ptr<MatchImageMaker> matcher;
  std::unique_ptr<Sweeper> sweeper;
  std::unique_ptr<Orthographer> orthographer;
  std::map<std::uint64_t, std::pair<capture::CameraModel, Loader>> loaders;
  // Match images of frames that the cache still holds.
  std::map<std::uint64_t, std::pair<std::weak_ptr<const RectifiedFrame>, gl::Texture>> match_images;
  std::map<geo::TileKey, SweptCell> cells;
  std::set<geo::TileKey> forgotten;  // swept once, and no longer among `cells`
  std::uint64_t clock = 0;
  ExposureBalance balance;
  std::map<std::uint64_t, float> gains;
  MapperStatistics statistics;

  struct Held {
    RectifiedPtr frame;
    const gl::Texture* match = nullptr;
  };
  Result<void> makeOnGpu(gl::Context& new_context);
  Result<Held> hold(std::uint64_t id, bool with_match);
  Result<SweptCell*> swept(const geo::TileKey& cell, bool* changed);
  struct ColourView {
    const IndexedFrame* frame;
    double worth;  // by its age alone
  };
  std::vector<ColourView> colourViews(const geo::TileKey& cell) const;
  Result<std::vector<Tile>> colour(const geo::TileKey& cell, HeightMosaic mosaic,
                                   std::set<std::uint64_t> frame_set);
  void forgetOldCells();
  std::function<bool()> pause;
  Result<void> rest() const {
    if (pause && !pause()) return fail(ErrorCode::Unavailable, "the work was put aside");
    return {};
  }
};

Mapper::Mapper(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Mapper::~Mapper() = default;

Result<void> Mapper::Impl::makeOnGpu(gl::Context& new_context) {
  context = &new_context;
  match_images.clear();
  cache.reset();
  matcher.reset();
  sweeper.reset();
  orthographer.reset();
  auto rectifier = Rectifier::create(new_context);
  if (!rectifier) return tl::unexpected(rectifier.error());
  auto new_matcher = MatchImageMaker::create(new_context, options.match);
  if (!new_matcher) return tl::unexpected(new_matcher.error());
  auto new_sweeper = Sweeper::create(new_context);
  if (!new_sweeper) return tl::unexpected(new_sweeper.error());
  auto new_orthographer = Orthographer::create(new_context);
  if (!new_orthographer) return tl::unexpected(new_orthographer.error());
  cache = std::make_unique<FrameCache>(std::move(*rectifier), options.frame_cache_bytes);
  matcher = std::move(*new_matcher);
  sweeper = std::move(*new_sweeper);
  sweeper->onPause(pause);
  orthographer = std::move(*new_orthographer);
  return {};
}

Result<std::unique_ptr<Mapper>> Mapper::create(gl::Context& context, const MapperOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  if (auto made = impl->makeOnGpu(context); !made) return tl::unexpected(made.error());
  return std::unique_ptr<Mapper>(new Mapper(std::move(impl)));
}

Result<void> Mapper::renew(gl::Context& context, bool less_memory) {
  std::size_t& bytes = impl_->options.frame_cache_bytes;
  if (less_memory) bytes = std::min(bytes, std::max(bytes / 2, kLeastFrameBytes));
  return impl_->makeOnGpu(context);
}

Result<MapGround> Mapper::settleGround(std::span<const Thumbnail> first_frames,
                                       std::span<const capture::CameraModel> cameras,
                                       const geo::TileLattice& lattice, const GroundOptions& options) {
  if (first_frames.empty() || cameras.empty())
    return fail(ErrorCode::BadInput, "no frame with a pose to settle the map's place from");
  MapGround ground;
  ground.lattice = lattice;
  auto estimate = estimateGround(first_frames);
  if (!estimate && !options.height_m) return tl::unexpected(estimate.error());
  std::vector<double> heights;
  for (const Thumbnail& frame : first_frames)
    heights.push_back(geo::geodeticFromEcef(frame.pose.position_in_ecef).height_m);
  std::nth_element(heights.begin(), heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2),
                   heights.end());
  const double camera = heights[heights.size() / 2];
  const double highest_camera = *std::max_element(heights.begin(), heights.end());
  ground.height_m = options.height_m ? *options.height_m : estimate->height_m;
  const double above = camera - ground.height_m;
  if (!(above > 0.5))
    return fail(
        ErrorCode::BadInput,
        fmt::format(
            "the cameras would be {:.1f} m above the ground at {:.1f} m: give its height with --ground",
            above, ground.height_m));
  // Sloping ground shows in the spread of the pairs; a pair that lies far off is an error, not a slope.
  const double slope_down =
      estimate ? std::clamp(ground.height_m - estimate->lowest_m, 0.0, 0.3 * above) : 0.0;
  const double slope_up =
      estimate ? std::clamp(estimate->highest_m - ground.height_m, 0.0, 0.3 * above) : 0.0;
  // Whole metres, so that small differences of the estimate do not move the planes.
  const double below_ground =
      options.search_below_m > 0 ? options.search_below_m : slope_down + 0.25 * above + 2;
  const double above_ground = options.search_above_m > 0 ? options.search_above_m : slope_up + 0.6 * above;
  ground.min_height_m = std::floor(ground.height_m - below_ground);
  ground.max_height_m = std::ceil(std::min(ground.height_m + above_ground, highest_camera - 0.05 * above));
  ground.gsd_m = above / cameras.front().fx;
  const geo::Geodetic place = geo::geodeticFromEcef(first_frames.front().pose.position_in_ecef);
  const auto plane = lattice.planeFromGeodetic(place.lat, place.lon);
  if (!plane)
    return fail(
        ErrorCode::BadSettings,
        fmt::format(
            "the lattice {} does not reach latitude {:.4f}: set map.lattice to a utm, ups or local one",
            lattice.text(), geo::degrees(place.lat)));
  ground.anchor_px = plane->x();
  ground.base_zoom =
      lattice.zoomForGsd(options.gsd_m.value_or(ground.gsd_m), place.lat, place.lon, options.tile_size);
  ground.texel_m = lattice.texelSize(ground.base_zoom, place.lat, place.lon, options.tile_size);
  return ground;
}

void Mapper::setGround(const MapGround& ground) {
  impl_->ground = ground;
  impl_->index = std::make_unique<FrameIndex>(ground.lattice);
  impl_->scale = 0;
  while (ground.texel_m * (1 << impl_->scale) <
         kFinerThanFrames * ground.gsd_m / impl_->options.working_scale)
    ++impl_->scale;
}

const MapGround& Mapper::ground() const { return impl_->ground; }
int Mapper::cellZoom() const { return impl_->ground.base_zoom - impl_->scale; }
const FrameIndex& Mapper::index() const { return *impl_->index; }
void Mapper::setOptions(const MapperOptions& options) {
  impl_->options.sweep = options.sweep;
  impl_->options.views = options.views;
  impl_->options.frames = options.frames;
  impl_->options.hole_texels = options.hole_texels;
}

void Mapper::onPause(std::function<bool()> pause) {
  impl_->pause = std::move(pause);
  impl_->sweeper->onPause(impl_->pause);
}

const MapperStatistics& Mapper::statistics() const { return impl_->statistics; }

std::vector<geo::TileKey> Mapper::rowByRow(const std::set<geo::TileKey>& cells) {
  std::vector<geo::TileKey> order(cells.begin(), cells.end());
  std::sort(order.begin(), order.end(), [](const geo::TileKey& a, const geo::TileKey& b) {
    return std::pair(a.y, a.x) < std::pair(b.y, b.x);
  });
  return order;
}

std::vector<geo::TileKey> Mapper::neighboursOf(const geo::TileKey& cell) {
  std::vector<geo::TileKey> keys;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) keys.push_back({cell.zoom, cell.x + dx, cell.y + dy});
  return keys;
}

Result<Thumbnail> Mapper::thumbnailOf(std::uint64_t id, const capture::FramePtr& frame) {
  if (!frame->pose) return fail(ErrorCode::BadInput, frame->name + " has no pose");
  const Stopwatch watch(impl_->statistics.rectify_s);
  auto rectified = impl_->cache->acquire(id, frame);
  if (!rectified) return tl::unexpected(rectified.error());
  const RectifiedFrame& image = **rectified;
  const int level = std::min(kThumbnailLevel, image.luma.spec().levels - 1);
  Thumbnail thumbnail;
  thumbnail.frame_id = id;
  thumbnail.pose = *frame->pose;
  thumbnail.camera = image.pinhole.scaled(1.0 / (1 << level));
  thumbnail.camera.width = image.luma.width(level);
  thumbnail.camera.height = image.luma.height(level);
  thumbnail.luma.resize(static_cast<std::size_t>(thumbnail.camera.width) *
                        static_cast<std::size_t>(thumbnail.camera.height));
  if (auto ok = image.luma.download(std::span<std::uint8_t>(thumbnail.luma), level); !ok)
    return tl::unexpected(ok.error());
  return thumbnail;
}

Result<std::vector<geo::TileKey>> Mapper::addFrame(std::uint64_t id, const capture::FramePtr& frame,
                                                   Loader load) {
  auto thumbnail = thumbnailOf(id, frame);
  if (!thumbnail) return tl::unexpected(thumbnail.error());
  auto rectified = impl_->cache->acquire(id, frame);
  if (!rectified) return tl::unexpected(rectified.error());
  const MapGround& ground = impl_->ground;
  auto record = makeIndexedFrame(id, frame->camera, *frame->pose, (*rectified)->stats.sharpness,
                                 ground.lattice, ground.anchor_px, ground.height_m, impl_->options.frames);
  if (!record) return tl::unexpected(record.error());
  record->utc_ns = frame->time_ns + frame->utc_offset_ns;
  std::set<geo::TileKey> touched;
  if (const IndexedFrame* old = impl_->index->find(id))
    for (const geo::TileKey& key : FrameIndex::tilesUnder(*old, cellZoom())) touched.insert(key);
  if (record->near_vertical) {
    for (const geo::TileKey& key : FrameIndex::tilesUnder(*record, cellZoom())) touched.insert(key);
    impl_->balance.add(std::move(*thumbnail), ground.height_m);
  }
  impl_->index->insert(*record);
  impl_->loaders.insert_or_assign(id, std::pair(frame->camera, std::move(load)));
  ++impl_->statistics.frames;
  return std::vector(touched.begin(), touched.end());
}

std::vector<geo::TileKey> Mapper::balanceExposure() {
  std::map<std::uint64_t, float> solved = impl_->balance.solve();
  std::set<geo::TileKey> touched;
  for (auto& [id, gain] : solved) {
    // In steps, and not "when it has moved enough": the gains are a function of the frames alone.
    gain = std::exp(std::round(std::log(gain) / 0.01f) * 0.01f);
    const auto old = impl_->gains.find(id);
    if (gain == (old == impl_->gains.end() ? 1.0f : old->second)) continue;
    if (const IndexedFrame* record = impl_->index->find(id))
      for (const geo::TileKey& key : FrameIndex::tilesUnder(*record, cellZoom())) touched.insert(key);
  }
  impl_->gains = std::move(solved);
  return {touched.begin(), touched.end()};
}

Result<Mapper::Impl::Held> Mapper::Impl::hold(std::uint64_t id, bool with_match) {
  const auto& [camera, load] = loaders.at(id);
  Held held;
  {
    const Stopwatch watch(statistics.rectify_s);
    auto frame = cache->acquire(id, camera, load);
    if (!frame) return tl::unexpected(frame.error());
    held.frame = *frame;
  }
  if (!with_match) return held;
  auto found = match_images.find(id);
  if (found == match_images.end() || found->second.first.lock() != held.frame) {
    const Stopwatch watch(statistics.match_s, &statistics.sweep_processor_s);
    std::erase_if(match_images, [](const auto& entry) { return entry.second.first.expired(); });
    auto match = matcher->make(held.frame->luma, held.frame->color);
    if (!match) return tl::unexpected(match.error());
    found = match_images.insert_or_assign(id, std::pair(std::weak_ptr(held.frame), std::move(*match))).first;
  }
  held.match = &found->second.second;
  return held;
}

void Mapper::Impl::forgetOldCells() {
  while (static_cast<int>(cells.size()) > options.field_cache) {
    const auto oldest = std::min_element(cells.begin(), cells.end(), [](const auto& a, const auto& b) {
      return a.second.last_use < b.second.last_use;
    });
    forgotten.insert(oldest->first);
    cells.erase(oldest);
  }
}

Result<SweptCell*> Mapper::Impl::swept(const geo::TileKey& cell, bool* changed) {
  const std::vector<const IndexedFrame*> candidates =
      recentFrames(index->framesForTile(cell, ground.min_height_m, ground.max_height_m), ground.lattice, cell,
                   ground.height_m, options.recency);
  ViewSelectionOptions view_options = options.views;
  view_options.max_views = std::min(options.sweep.max_views, SweepOptions::kMaxViews);
  const std::vector<SelectedView> selected =
      selectViews(candidates, ground.lattice, cell, ground.height_m, view_options);
  std::vector<std::uint64_t> ids;
  std::vector<capture::Pose> poses;
  for (const SelectedView& view : selected) {
    ids.push_back(view.id);
    poses.push_back(index->find(view.id)->pose);
  }
  const int coarser = coarserThanCell(selected, ground.texel_m * (1 << scale), options.working_scale);
  SweepOptions sweep = options.sweep;
  sweep.finest_level += coarser;
  sweep.levels += coarser;
  SweptCell& entry = cells[cell];
  forgotten.erase(cell);
  entry.last_use = ++clock;
  const bool same = !entry.field.height.empty() && entry.views == ids && entry.options == sweep &&
                    std::equal(poses.begin(), poses.end(), entry.poses.begin(), entry.poses.end(), samePose);
  if (changed != nullptr) *changed = !same;
  if (same) return &entry;

  std::vector<Held> held;
  std::vector<SweepView> views;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    auto frame = hold(ids[i], options.sweep.cost == MatchCost::Zncc);
    if (!frame) return tl::unexpected(frame.error());
    views.push_back({ids[i], frame->match != nullptr ? frame->match : &frame->frame->luma,
                     frame->frame->pinhole, poses[i]});
    held.push_back(std::move(*frame));
  }
  const geo::TileFrame frame(ground.lattice, cell);
  const SweepGrid grid{&frame,          options.tile_size,   16,
                       ground.height_m, ground.min_height_m, ground.max_height_m};
  const Stopwatch watch(statistics.sweep_s, &statistics.sweep_processor_s);
  auto field = sweeper->run(grid, views, sweep);
  if (!field) return tl::unexpected(field.error());
  statistics.samples += field->samples;
  ++statistics.cells_swept;
  entry.field = std::move(*field);
  entry.views = std::move(ids);
  entry.poses = std::move(poses);
  entry.options = sweep;
  entry.coarser = coarser;
  return &entry;
}

Result<bool> Mapper::sweepCell(const geo::TileKey& cell) {
  bool changed = false;
  auto entry = impl_->swept(cell, &changed);
  if (!entry) return tl::unexpected(entry.error());
  impl_->forgetOldCells();
  return changed;
}

// The frames that look most steeply at nine places of the cell, in turns, so that each place has its best.
std::vector<Mapper::Impl::ColourView> Mapper::Impl::colourViews(const geo::TileKey& cell) const {
  const std::vector<const IndexedFrame*> candidates =
      recentFrames(index->framesForTile(cell, ground.min_height_m, ground.max_height_m), ground.lattice, cell,
                   ground.height_m, options.recency);
  std::vector<std::vector<std::pair<double, const IndexedFrame*>>> ranked;
  for (const double fy : {0.5, 0.05, 0.95})
    for (const double fx : {0.5, 0.05, 0.95}) {
      const Eigen::Vector2d place = geo::TileLattice::planeOf(cell, fx, fy);
      auto& list = ranked.emplace_back();
      for (const IndexedFrame* frame : candidates) {
        if (!inPolygon(frame->footprintAt(ground.height_m), place)) continue;
        const double away =
            (frame->nadir - place).norm() / std::max(frame->camera_height_m - ground.height_m, 1.0);
        list.emplace_back(away, frame);
      }
      std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) {
        return std::pair(a.first, a.second->id) < std::pair(b.first, b.second->id);
      });
    }
  std::vector<const IndexedFrame*> chosen;
  std::set<std::uint64_t> taken;
  for (std::size_t round = 0; round < candidates.size(); ++round)
    for (const auto& list : ranked) {
      if (round >= list.size() || static_cast<int>(chosen.size()) >= Orthographer::kMaxViews) continue;
      if (taken.insert(list[round].second->id).second) chosen.push_back(list[round].second);
    }
  // A frame may see no more than a corner between those places, at the map's rim.
  for (const IndexedFrame* frame : candidates)
    if (static_cast<int>(chosen.size()) < Orthographer::kMaxViews && taken.insert(frame->id).second)
      chosen.push_back(frame);
  const std::vector<double> worth = recencyWorth(candidates, options.recency);
  std::vector<ColourView> views;
  for (std::size_t i = 0; i < candidates.size(); ++i)
    if (std::find(chosen.begin(), chosen.end(), candidates[i]) != chosen.end())
      views.push_back({candidates[i], worth[i]});
  std::sort(views.begin(), views.end(),
            [](const ColourView& one, const ColourView& other) { return one.frame->id < other.frame->id; });
  return views;
}

Result<std::vector<Tile>> Mapper::Impl::colour(const geo::TileKey& cell, HeightMosaic mosaic,
                                               std::set<std::uint64_t> frame_set) {
  const std::vector<ColourView> sources = colourViews(cell);
  std::vector<Held> held;
  std::vector<OrthoView> views;
  double sharpest = 0;
  for (const ColourView& source : sources) sharpest = std::max(sharpest, source.frame->sharpness);
  for (const auto& [source, by_age] : sources) {
    auto frame = hold(source->id, false);
    if (!frame) return tl::unexpected(frame.error());
    const auto gain = gains.find(source->id);
    const double worth = sharpest > 0 ? std::clamp(source->sharpness / sharpest, 0.25, 1.0) : 1.0;
    views.push_back({source->id, &frame->frame->color, frame->frame->pinhole, source->pose,
                     gain == gains.end() ? 1.0f : gain->second, static_cast<float>(worth * by_age)});
    frame_set.insert(source->id);
    held.push_back(std::move(*frame));
  }

  const int side = mosaic.side();
  std::vector<std::uint8_t> provisional(mosaic.height.size());
  for (std::size_t i = 0; i < provisional.size(); ++i) provisional[i] = std::isnan(mosaic.height[i]) ? 1 : 0;
  const double texel_m = ground.texel_m * (options.tile_size << scale) / mosaic.texels;
  const std::vector<float> surface = guessSurface(mosaic.height, side, 2 * texel_m, ground.height_m);
  const geo::TileFrame frame(ground.lattice, cell);
  const int size = options.tile_size << scale;
  if (auto ok = rest(); !ok) return tl::unexpected(ok.error());
  const Stopwatch watch(statistics.ortho_s);
  auto photo = orthographer->render({&frame, mosaic.texels, mosaic.margin, surface, provisional}, views, size,
                                    options.fallback);
  if (!photo) return tl::unexpected(photo.error());

  const std::vector<std::uint64_t> set(frame_set.begin(), frame_set.end());
  std::vector<std::uint16_t> source_of(views.size());
  for (std::size_t k = 0; k < views.size(); ++k)
    source_of[k] =
        static_cast<std::uint16_t>(std::lower_bound(set.begin(), set.end(), views[k].frame_id) - set.begin());
  std::vector<Tile> tiles;
  const int per_side = 1 << scale;
  const double grid_from_texel = static_cast<double>(mosaic.texels) / size;
  for (int ty = 0; ty < per_side; ++ty)
    for (int tx = 0; tx < per_side; ++tx) {
      Tile tile =
          Tile::blank({ground.base_zoom, cell.x * per_side + tx, cell.y * per_side + ty}, options.tile_size);
      tile.frame_set = set;
      for (int y = 0; y < tile.size; ++y)
        for (int x = 0; x < tile.size; ++x) {
          const auto out =
              static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.size) + static_cast<std::size_t>(x);
          const int px = tx * tile.size + x, py = ty * tile.size + y;
          const auto in =
              static_cast<std::size_t>(py) * static_cast<std::size_t>(size) + static_cast<std::size_t>(px);
          std::copy_n(&photo->color[4 * in], 4, &tile.color[4 * out]);
          if (photo->source[in] != 65535) tile.source[out] = source_of[photo->source[in]];
          tile.views[out] = photo->seen_by[in];
          tile.gsd[out] = gsdCode(static_cast<double>(photo->gsd_m[in]));
          if (photo->source[in] != 65535) tile.angle[out] = angleCode(static_cast<double>(photo->tilt[in]));
          // The height at the texel's centre: bilinear in the sweep's grid, unless a neighbour is missing.
          const double gx = (px + 0.5) * grid_from_texel - 0.5 + mosaic.margin,
                       gy = (py + 0.5) * grid_from_texel - 0.5 + mosaic.margin;
          const auto ix = static_cast<std::size_t>(gx), iy = static_cast<std::size_t>(gy);
          const auto n = static_cast<std::size_t>(side);
          const std::size_t nearest =
              static_cast<std::size_t>(std::lround(gy)) * n + static_cast<std::size_t>(std::lround(gx));
          if (photo->color[4 * in + 3] != 0 && std::isnan(mosaic.height[nearest]))
            tile.kind[out] = kProvisional;
          if (std::isnan(mosaic.height[nearest])) continue;
          const auto fx = static_cast<float>(gx - static_cast<double>(ix)),
                     fy = static_cast<float>(gy - static_cast<double>(iy));
          const float* top = &mosaic.height[iy * n + ix];
          const float value =
              (1 - fy) * ((1 - fx) * top[0] + fx * top[1]) + fy * ((1 - fx) * top[n] + fx * top[n + 1]);
          tile.elevation[out] = std::isnan(value) ? mosaic.height[nearest] : value;
          tile.kind[out] = mosaic.filled[nearest] != 0 ? kFilled : kMeasured;
          tile.confidence[out] = mosaic.confidence[nearest];
        }
      if (!tile.empty()) tiles.push_back(std::move(tile));
    }
  ++statistics.cells_finished;
  statistics.tiles += tiles.size();
  return tiles;
}

Result<std::vector<Tile>> Mapper::finishCell(const geo::TileKey& cell, Around neighbours) {
  std::array<const HeightField*, 9> fields{};
  std::set<std::uint64_t> frame_set;
  const std::vector<geo::TileKey> around = neighboursOf(cell);
  double step_m = 0;
  int coarser = 0;
  const auto take = [&](std::size_t i, const SweptCell& swept) {
    fields[i] = &swept.field;
    frame_set.insert(swept.views.begin(), swept.views.end());
    step_m = std::max(step_m, swept.field.plane_step_m);
    if (around[i] == cell) coarser = swept.coarser;
  };
  for (std::size_t i = 0; i < around.size(); ++i) {
    if (neighbours == Around::AsSwept) {
      const auto known = impl_->cells.find(around[i]);
      // One that has left the memory is swept again, so that the tile does not lose its rim.
      if (around[i] != cell && known == impl_->cells.end() && !impl_->forgotten.contains(around[i])) continue;
      if (known != impl_->cells.end() && !known->second.field.height.empty()) {
        known->second.last_use = ++impl_->clock;
        take(i, known->second);
        continue;
      }
    }
    auto entry = impl_->swept(around[i], nullptr);
    if (!entry) return tl::unexpected(entry.error());
    take(i, **entry);
  }
  HeightMosaic mosaic;
  {
    const Stopwatch watch(impl_->statistics.blend_s);
    mosaic = assembleHeights(fields, kSurfaceMargin, 2.0 * step_m);
    // As wide in texels of the frames, whatever grid they are swept on.
    const int hole_texels = (impl_->options.hole_texels << (2 * coarser)) >> (2 * mosaic.halvings);
    const auto fill = [&](std::vector<float>& height, std::vector<std::uint8_t>& filled) {
      fillHoles(height, filled, mosaic.side(), hole_texels, 3.0 * step_m);
    };
    std::vector<float> closed = mosaic.height;
    std::vector<std::uint8_t> closed_marks = mosaic.filled;
    fill(closed, closed_marks);
    removeNeedles(mosaic.height, closed, mosaic.side(),
                  impl_->ground.texel_m * (impl_->options.tile_size << impl_->scale) / mosaic.texels);
    fill(mosaic.height, mosaic.filled);
  }
  auto tiles = impl_->colour(cell, std::move(mosaic), std::move(frame_set));
  impl_->forgetOldCells();
  return tiles;
}

Result<std::vector<Tile>> Mapper::provisionalCell(const geo::TileKey& cell) {
  HeightMosaic mosaic;
  mosaic.texels = impl_->options.tile_size;
  mosaic.margin = 1;
  const auto count = static_cast<std::size_t>(mosaic.side()) * static_cast<std::size_t>(mosaic.side());
  mosaic.height.assign(count, std::numeric_limits<float>::quiet_NaN());
  mosaic.confidence.assign(count, 0);
  mosaic.filled.assign(count, 0);
  return impl_->colour(cell, std::move(mosaic), {});
}

Result<std::vector<Tile>> Mapper::colourOn(const geo::TileKey& cell,
                                           const std::array<std::vector<float>, 9>& heights) {
  HeightMosaic mosaic;
  mosaic.texels = impl_->options.tile_size << impl_->scale;
  mosaic.margin = std::min(kSurfaceMargin, mosaic.texels);
  const int side = mosaic.side();
  const auto texels = static_cast<std::size_t>(mosaic.texels);
  for (const std::vector<float>& field : heights)
    if (!field.empty() && field.size() != texels * texels)
      return fail(ErrorCode::Internal, "heights of another size than the cell");
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const int px = x - mosaic.margin + mosaic.texels, py = y - mosaic.margin + mosaic.texels;
      const std::vector<float>& field =
          heights[static_cast<std::size_t>(py / mosaic.texels * 3 + px / mosaic.texels)];
      mosaic.height.push_back(field.empty() ? std::numeric_limits<float>::quiet_NaN()
                                            : field[static_cast<std::size_t>(py % mosaic.texels) * texels +
                                                    static_cast<std::size_t>(px % mosaic.texels)]);
    }
  mosaic.confidence.assign(mosaic.height.size(), 0);
  mosaic.filled.assign(mosaic.height.size(), 0);
  auto tiles = impl_->colour(cell, std::move(mosaic), {});
  if (!tiles) return tiles;
  for (Tile& tile : *tiles)
    for (std::size_t i = 0; i < tile.texels(); ++i)
      if (std::isnan(tile.elevation[i])) std::fill_n(&tile.color[4 * i], 4, std::uint8_t{0});
  return tiles;
}

}  // namespace overfly::tiling
