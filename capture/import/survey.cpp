#include "capture/import/survey.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "capture/geo/footprint.h"

namespace overfly::capture {
namespace {

constexpr double kStripTurn = 60.0 * 3.14159265358979323846 / 180.0;
constexpr double kCellsAcross = 400;  // of the longer side of all footprints
constexpr int kEdgePoints = 8;        // of the footprint's outline per side: the lens bends it
constexpr double kTooLarge_m = 200'000;

using Polygon = std::vector<Eigen::Vector2d>;  // metres east and north of the survey's origin

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Seen {
  Polygon outline;
  Eigen::Vector2d camera;
  std::vector<std::uint32_t> cells;  // sorted
  int strip = 0;
};

// Outline of an image on the ground: the footprint's test has passed, so corners meet it; a point of an edge
// that does not is left out.
Polygon outlineOf(const CameraModel& camera, const Pose& pose, double height_m,
                  const geo::LocalFrame& local) {
  Polygon outline;
  const double w = camera.width, h = camera.height;
  const Eigen::Vector2d corners[5] = {{0, 0}, {w, 0}, {w, h}, {0, h}, {0, 0}};
  for (int side = 0; side < 4; ++side) {
    for (int i = 0; i < kEdgePoints; ++i) {
      const Eigen::Vector2d pixel =
          corners[side] + (corners[side + 1] - corners[side]) * (static_cast<double>(i) / kEdgePoints);
      const auto ray = camera.unproject(pixel);
      if (!ray) continue;
      const auto place = geo::intersectHeight(pose.position_in_ecef, pose.ecef_from_camera * *ray, height_m);
      if (place) outline.push_back(local.enuFromEcef(*place).head<2>());
    }
  }
  return outline;
}

// Cells whose centre lies inside, row by row (even-odd rule).
std::vector<std::uint32_t> cellsOf(const Polygon& outline, const Eigen::Vector2d& corner, double cell,
                                   int columns, int rows) {
  std::vector<std::uint32_t> cells;
  std::vector<double> crossings;
  for (int row = 0; row < rows; ++row) {
    const double y = corner.y() + (row + 0.5) * cell;
    crossings.clear();
    for (std::size_t i = 0; i < outline.size(); ++i) {
      const Eigen::Vector2d &a = outline[i], &b = outline[(i + 1) % outline.size()];
      if ((a.y() <= y) != (b.y() <= y))
        crossings.push_back(a.x() + (y - a.y()) / (b.y() - a.y()) * (b.x() - a.x()));
    }
    std::sort(crossings.begin(), crossings.end());
    for (std::size_t i = 0; i + 1 < crossings.size(); i += 2) {
      const int first = std::max(0, static_cast<int>(std::ceil((crossings[i] - corner.x()) / cell - 0.5)));
      const int last =
          std::min(columns - 1, static_cast<int>(std::floor((crossings[i + 1] - corner.x()) / cell - 0.5)));
      for (int column = first; column <= last; ++column) {
        cells.push_back(static_cast<std::uint32_t>(row * columns + column));
      }
    }
  }
  return cells;
}

double shared(const Seen& a, const Seen& b) {
  if (a.cells.empty()) return 0;
  std::vector<std::uint32_t> both;
  std::set_intersection(a.cells.begin(), a.cells.end(), b.cells.begin(), b.cells.end(),
                        std::back_inserter(both));
  return static_cast<double>(both.size()) / static_cast<double>(a.cells.size());
}

int numberStrips(std::vector<Seen>& seen) {
  int strip = 0;
  std::optional<Eigen::Vector2d> course;
  for (std::size_t i = 1; i < seen.size(); ++i) {
    const Eigen::Vector2d step = seen[i].camera - seen[i - 1].camera;
    if (step.norm() > 0.1) {
      const bool turns = course && std::abs(std::atan2(course->x() * step.y() - course->y() * step.x(),
                                                       course->dot(step))) > kStripTurn;
      if (turns) ++strip;
      // The leg between two strips is a turn at both ends and counts with the new one.
      course = turns ? std::nullopt : std::optional<Eigen::Vector2d>(step);
    }
    seen[i].strip = strip;
  }
  return strip + 1;
}

}  // namespace

Result<Survey> surveyFlight(const Flight& flight, std::optional<double> ground_height_m) {
  Survey survey;
  if (ground_height_m) {
    survey.ground_height_m = *ground_height_m;
    survey.ground_reason = "as given";
  } else if (flight.info().ground_height_m) {
    survey.ground_height_m = *flight.info().ground_height_m;
    survey.ground_reason = flight.info().ground_reason;
  } else {
    return fail(ErrorCode::Unavailable, "the height of the ground is not known: give it with --ground");
  }

  std::optional<geo::LocalFrame> local;
  std::vector<Seen> seen;
  std::vector<double> gsds;
  Eigen::AlignedBox2d extent;
  for (const FlightFrame& entry : flight.frames()) {
    const Frame& frame = entry.frame;
    if (!frame.pose) continue;
    const auto footprint = geo::footprint(frame.camera, *frame.pose, survey.ground_height_m);
    if (!footprint) {
      survey.refused.push_back(fmt::format("{}: {}", frame.name, footprint.error().message));
      continue;
    }
    if (!local) local.emplace(footprint->centre);
    Seen one;
    one.outline = outlineOf(frame.camera, *frame.pose, survey.ground_height_m, *local);
    one.camera = local->enuFromEcef(frame.pose->position_in_ecef).head<2>();
    for (const Eigen::Vector2d& point : one.outline) extent.extend(point);
    gsds.push_back(footprint->gsd_m);
    seen.push_back(std::move(one));
  }
  survey.frames_with_footprint = seen.size();
  if (seen.empty()) {
    return fail(ErrorCode::Unavailable,
                survey.refused.empty() ? "no frame has a pose"
                                       : "no frame sees the ground; the first: " + survey.refused.front());
  }
  const double longest = extent.sizes().maxCoeff();
  if (!(longest < kTooLarge_m)) {
    return fail(ErrorCode::BadInput, fmt::format("the frames lie {:.0f} km apart", longest / 1000));
  }
  survey.gsd_m = median(gsds);

  const double cell = longest / kCellsAcross;
  const int columns = static_cast<int>(extent.sizes().x() / cell) + 1,
            rows = static_cast<int>(extent.sizes().y() / cell) + 1;
  std::vector<std::uint32_t> counts(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  for (Seen& one : seen) {
    one.cells = cellsOf(one.outline, extent.min(), cell, columns, rows);
    for (const std::uint32_t at : one.cells) ++counts[at];
  }
  std::size_t once = 0, thrice = 0, sum = 0;
  for (const std::uint32_t count : counts) {
    once += count >= 1 ? 1 : 0;
    thrice += count >= 3 ? 1 : 0;
    sum += count;
  }
  survey.area_m2 = static_cast<double>(once) * cell * cell;
  survey.area3_m2 = static_cast<double>(thrice) * cell * cell;
  survey.mean_overlap = once > 0 ? static_cast<double>(sum) / static_cast<double>(once) : 0;

  survey.strips = numberStrips(seen);
  std::vector<double> forward, sideways;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (i + 1 < seen.size() && seen[i].strip == seen[i + 1].strip) {
      if (const double share = shared(seen[i], seen[i + 1]); share > 0) forward.push_back(share);
    }
    double best = 0;
    const auto window = static_cast<std::size_t>(400);  // frames: bounds the work on a very long flight
    for (std::size_t j = i > window ? i - window : 0; j < std::min(seen.size(), i + window); ++j) {
      if (seen[j].strip != seen[i].strip) best = std::max(best, shared(seen[i], seen[j]));
    }
    if (best > 0) sideways.push_back(best);
  }
  if (!forward.empty()) survey.forward_overlap = median(forward);
  if (!sideways.empty()) survey.sideways_overlap = median(sideways);
  return survey;
}

}  // namespace overfly::capture
