#include "tests/bench/sweep/site.h"

#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "capture/import/import_flight.h"
#include "tiling/index/view_selection.h"

namespace overfly::bench {

using namespace overfly::tiling;

double cpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

Site::Site(gl::Context& context, const std::string& folder)
    : context_(&context), flight_(need(capture::importFlight(folder))) {
  if (!flight_.info().origin) throw std::runtime_error(folder + " has no local origin");
  points_ = need(
      readReferencePoints(std::filesystem::path(folder) / "reference_points.csv", *flight_.info().origin));
  double mean_track = 0;
  for (const ReferencePoint& point : points_) mean_track += point.track / static_cast<double>(points_.size());
  std::erase_if(points_, [&](const ReferencePoint& point) { return point.track < std::lround(mean_track); });

  mapper_ = need(Mapper::create(context, {}));
  cache_ = std::make_unique<FrameCache>(need(Rectifier::create(context)), std::size_t{1} << 30);
  matcher_ = need(MatchImageMaker::create(context));
  std::vector<Thumbnail> first;
  std::vector<capture::CameraModel> cameras;
  for (std::size_t i = 0; i < flight_.size() && first.size() < 8; ++i) {
    if (!flight_.at(i).frame.pose) continue;
    const capture::FramePtr frame = need(flight_.load(i));
    first.push_back(need(mapper_->thumbnailOf(i, frame)));
    cameras.push_back(frame->camera);
  }
  ground_ = need(Mapper::settleGround(first, cameras, geo::TileLattice::webMercator()));
  mapper_->setGround(ground_);
  for (std::size_t i = 0; i < flight_.size(); ++i)
    if (flight_.at(i).frame.pose)
      static_cast<void>(
          need(mapper_->addFrame(i, need(flight_.load(i)), [this, i] { return flight_.load(i); })));
}

std::vector<Site::Cell> Site::cells(std::size_t min_points, std::size_t min_views) const {
  std::map<geo::TileKey, Cell> found;
  for (const ReferencePoint& point : points_) {
    const auto plane = ground_.lattice.planeFromGeodetic(point.place.lat, point.place.lon, ground_.anchor_px);
    if (!plane) continue;
    const geo::TileKey key = geo::TileLattice::keyAt(*plane, mapper_->cellZoom());
    found[key].key = key;
    found[key].points.push_back(point);
  }
  std::vector<Cell> result;
  for (auto& [key, cell] : found) {
    if (cell.points.size() < min_points) continue;
    const auto candidates = mapper_->index().framesForTile(key, ground_.min_height_m, ground_.max_height_m);
    for (const SelectedView& view : selectViews(candidates, ground_.lattice, key, ground_.height_m))
      cell.views.push_back(view.id);
    if (cell.views.size() >= min_views) result.push_back(std::move(cell));
  }
  return result;
}

Site::Views Site::viewsOf(const Cell& cell, std::size_t count) const {
  Views views;
  count = std::min(count, cell.views.size());
  views.match.reserve(count);
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint64_t id = cell.views[k];
    const capture::FramePtr frame = need(flight_.load(id));
    views.frames.push_back(need(cache_->acquire(id, frame)));
    const RectifiedFrame& image = *views.frames.back();
    views.match.push_back(need(matcher_->make(image.luma, image.color)));
    views.on_match.push_back({id, &views.match.back(), image.pinhole, *frame->pose});
    views.on_luma.push_back({id, &image.luma, image.pinhole, *frame->pose});
  }
  return views;
}

RectifyTimes Site::uploadTimes(const Cell& cell, std::size_t count) const {
  Rectifier rectifier = need(Rectifier::create(*context_));
  RectifyTimes sum;
  // The first frame makes the camera's map and programs: not counted.
  static_cast<void>(need(rectifier.rectify(0, *need(flight_.load(cell.views[0])))));
  for (std::size_t k = 0; k < std::min(count, cell.views.size()); ++k) {
    const RectifiedFrame frame = need(rectifier.rectify(1, *need(flight_.load(cell.views[k]))));
    context_->finish();
    sum.decode_s += frame.times.decode_s;
    sum.upload_s += frame.times.upload_s;
    sum.gpu_s += frame.times.gpu_s;
  }
  return sum;
}

SweepGrid Site::grid(const geo::TileFrame& frame, int texels) const {
  return {&frame, texels, 16, ground_.height_m, ground_.min_height_m, ground_.max_height_m};
}

std::vector<double> Site::errors(const Cell& cell, const HeightField& field) const {
  std::vector<double> result;
  for (const ReferencePoint& point : cell.points) {
    const auto plane = ground_.lattice.planeFromGeodetic(point.place.lat, point.place.lon, ground_.anchor_px);
    const Eigen::Vector2d in_cell =
        *plane * std::ldexp(1.0, cell.key.zoom) -
        Eigen::Vector2d(static_cast<double>(cell.key.x), static_cast<double>(cell.key.y));
    const Eigen::Vector2d at = (in_cell * field.texels).array() - 0.5 + field.apron;
    const auto ix = static_cast<int>(std::floor(at.x())), iy = static_cast<int>(std::floor(at.y()));
    const double fx = at.x() - ix, fy = at.y() - iy;
    double height = 0;
    for (int k = 0; k < 4; ++k)
      height += ((k & 1) != 0 ? fx : 1 - fx) * ((k >> 1) != 0 ? fy : 1 - fy) *
                static_cast<double>(
                    field.height[static_cast<std::size_t>((iy + (k >> 1)) * field.side() + ix + (k & 1))]);
    result.push_back((height - point.place.height_m) / ground_.gsd_m);
  }
  return result;
}

Summary summarise(const std::vector<double>& errors) {
  std::vector<double> finite;
  for (const double e : errors)
    if (std::isfinite(e)) finite.push_back(e);
  const ErrorStatistics s = statisticsOf(finite, std::max<std::size_t>(errors.size(), 1));
  return {s.median, s.nmad, s.measured};
}

}  // namespace overfly::bench
