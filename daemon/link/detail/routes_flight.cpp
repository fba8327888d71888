#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "daemon/link/detail/image_codec.h"
#include "daemon/link/detail/routes.h"

namespace overfly::link {

namespace {
constexpr auto kShotsAge = std::chrono::milliseconds(1000);  // how old the frames' table may be
constexpr std::size_t kTrackPage = 500;

double rounded(double degrees) { return std::round(degrees * 1e8) / 1e8; }
}  // namespace

// The frames of a mission as the page and the coverage want them; immutable once made.
struct Routes::Shots {
  std::chrono::steady_clock::time_point read_at;
  std::uint64_t stamp = 0;  // changes when any footprint does
  std::vector<Quad> quads;
  std::vector<tiling::FrameRecord> frames;
};

std::shared_ptr<const Routes::Shots> Routes::shots(const Visit& visit) {
  const std::lock_guard lock(shots_mutex_);
  auto& known = shots_[visit.mission.id];
  const auto now = std::chrono::steady_clock::now();
  if (known && now - known->read_at < kShotsAge) return known;
  auto fresh = std::make_shared<Shots>();
  fresh->read_at = now;
  if (auto frames = visit.view.reader().frames()) fresh->frames = std::move(*frames);
  const auto bounds = visit.view.reader().bounds(tiling::Layer::Color);
  const double near = bounds ? 0.5 * (bounds->west + bounds->east) : 0.5;
  std::uint64_t stamp = 0xcbf29ce484222325ull;
  for (const auto& frame : fresh->frames) {
    if (!frame.footprint || frame.state == tiling::FrameState::Refused) continue;
    Quad quad;
    bool whole = true;
    for (std::size_t i = 0; i < 4; ++i) {
      const auto& corner = frame.footprint->corners[i];
      const auto plane = visit.view.lattice().planeFromGeodetic(corner.lat, corner.lon, near);
      whole = whole && plane;
      if (plane) quad[i] = *plane;
      stamp = (stamp ^ static_cast<std::uint64_t>(std::llround((corner.lat + 7 * corner.lon) * 1e12))) *
              0x100000001b3ull;
    }
    if (whole) fresh->quads.push_back(quad);
  }
  fresh->stamp = stamp ^ fresh->quads.size();
  known = fresh;
  return fresh;
}

Response Routes::track(const Visit& visit) {
  std::uint64_t after = 0;
  bool all = true;
  if (const auto text = visit.request.arg("after")) {
    const auto id = parseCount(*text);
    if (!id) return Response::text(400, "after: the id of the last frame that is known\n");
    after = *id;
    all = false;
  }
  const auto known = shots(visit);
  auto list = nlohmann::json::array();
  bool more = false;
  for (const auto& frame : known->frames) {
    if (!all && frame.id <= after) continue;
    if (list.size() == kTrackPage) {
      more = true;
      break;
    }
    nlohmann::json one{{"id", frame.id}, {"name", frame.name}, {"state", static_cast<int>(frame.state)}};
    if (frame.pose) {
      const auto g = geo::geodeticFromEcef(frame.pose->position_in_ecef);
      one["lat"] = rounded(geo::degrees(g.lat));
      one["lon"] = rounded(geo::degrees(g.lon));
      one["height_m"] = std::round(g.height_m * 100) / 100;
    }
    if (frame.utc_offset_ns != 0) one["utc_ms"] = (frame.time_ns + frame.utc_offset_ns) / 1000000;
    if (frame.footprint) {
      auto ring = nlohmann::json::array();
      for (const auto& corner : frame.footprint->corners)
        ring.push_back({rounded(geo::degrees(corner.lon)), rounded(geo::degrees(corner.lat))});
      one["footprint"] = ring;
      one["gsd_m"] = frame.footprint->gsd_m;
    }
    list.push_back(std::move(one));
  }
  auto out =
      Response::json(nlohmann::json{{"map", visit.view.meta().id}, {"frames", list}, {"more", more}}.dump());
  out.headers.emplace_back("Cache-Control", "no-cache");
  return out;
}

std::filesystem::path Routes::planPath(const Mission& mission) {
  auto path = mission.map;
  path += ".plan.geojson";
  return path;
}

std::optional<std::string> Routes::readPlan(const Mission& mission) {
  std::ifstream in(planPath(mission), std::ios::binary);
  if (!in) return std::nullopt;
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

Response Routes::plan(const Visit& visit) {
  const auto& request = visit.request;
  const std::lock_guard lock(plan_mutex_);
  const auto path = planPath(visit.mission);
  if (request.method == Method::Get) {
    const auto text = readPlan(visit.mission);
    if (!text) return Response::text(404, "There is no plan; PUT a GeoJSON polygon here.\n");
    auto out = Response::text(200, *text, "application/geo+json");
    out.headers.emplace_back("Cache-Control", "no-cache");
    return out;
  }
  std::error_code error;
  if (request.method == Method::Delete) {
    std::filesystem::remove(path, error);
    return Response::text(error ? 503 : 204, "");
  }
  if (const auto area = parsePlan(request.body, visit.view.lattice()); !area) return failure(area.error());
  auto temporary = path;
  temporary += ".new";
  const int fd = open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  bool written =
      fd >= 0 &&
      write(fd, request.body.data(), request.body.size()) == static_cast<ssize_t>(request.body.size()) &&
      fsync(fd) == 0;
  if (fd >= 0) close(fd);
  if (written) std::filesystem::rename(temporary, path, error);
  if (!written || error) return Response::text(503, "The plan could not be written beside the map.\n");
  return Response::text(204, "");
}

Response Routes::coverage(const Visit& visit) {
  int min_views = options_.coverage_views;
  if (const auto text = visit.request.arg("views")) {
    const auto count = parseCount(*text);
    if (!count || *count < 1 || *count > 100) return Response::text(400, "views: 1 ... 100\n");
    min_views = static_cast<int>(*count);
  }
  std::optional<PlannedArea> area;
  {
    const std::lock_guard lock(plan_mutex_);
    if (const auto text = readPlan(visit.mission)) {
      auto parsed = parsePlan(*text, visit.view.lattice());
      if (!parsed) return failure(parsed.error());
      area = std::move(*parsed);
    }
  }
  const auto known = shots(visit);
  const auto report = reportCoverage(area ? &*area : nullptr, known->quads, min_views, visit.view.lattice());
  auto out = Response::json(coverageJson(report));
  out.headers.emplace_back("Cache-Control", "no-cache");
  return out;
}

Response Routes::coverageTile(const Visit& visit, const TilePath& path) {
  if (path.extension != "png" && path.extension != "webp")
    return Response::text(404, "There is no such layer or format; see /tiles.json.\n");
  const auto known = shots(visit);
  const double cell = std::ldexp(1.0, -path.zoom);
  auto west = static_cast<double>(path.x) * cell;
  if (const auto bounds = visit.view.reader().bounds(tiling::Layer::Color))
    west += std::round(0.5 * (bounds->west + bounds->east) - west -
                       0.5 * cell);  // the copy of the world that the map is in
  const tiling::PlaneBox box{west, static_cast<double>(path.y) * cell, west + cell,
                             static_cast<double>(path.y + 1) * cell};
  const auto etag = fmt::format("\"c-{}-{:016x}-{}-{}-{}-{}\"", visit.view.meta().id.substr(0, 8),
                                known->stamp, path.zoom, path.x, path.y, path.extension);
  return conditional(visit.request, etag, [&] {
    Response out;
    out.headers.emplace_back("Content-Type", path.extension == "png" ? "image/png" : "image/webp");
    out.body = cache_.find(etag);
    if (out.body) return out;
    const auto image = coverageColours(countViews(box, kLinkTile, kLinkTile, known->quads));
    out.body = std::make_shared<const std::string>(path.extension == "png" ? encodePng(image)
                                                                           : encodeWebp(image, 101));
    cache_.add(etag, out.body);
    return out;
  });
}

}  // namespace overfly::link
