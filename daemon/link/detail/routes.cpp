#include "daemon/link/detail/routes.h"

#include <algorithm>

namespace overfly::link {

namespace {
constexpr std::size_t kRenderCacheBytes = 16u << 20;
}

Result<ViewPool::Lease> ViewPool::lease(const std::filesystem::path& path) {
  {
    const std::lock_guard lock(mutex_);
    auto& idle = idle_[path];
    if (!idle.empty()) {
      auto view = std::move(idle.back());
      idle.pop_back();
      return Lease(view.release(), Return{this, path});
    }
  }
  auto view = MapView::open(path, overzoom_);
  if (!view) return tl::unexpected(view.error());
  return Lease(view->release(), Return{this, path});
}

void ViewPool::giveBack(const std::filesystem::path& path, MapView* view) {
  std::unique_ptr<MapView> owned(view);
  const std::lock_guard lock(mutex_);
  if (const auto idle = idle_.find(path); idle != idle_.end() && idle->second.size() < 4)
    idle->second.push_back(std::move(owned));
}

void ViewPool::forgetAllBut(const std::vector<Mission>& missions) {
  const std::lock_guard lock(mutex_);
  std::erase_if(idle_, [&](const auto& entry) {
    return std::ranges::none_of(missions, [&](const Mission& m) { return m.map == entry.first; });
  });
}

std::shared_ptr<const std::string> RenderCache::find(const std::string& etag) {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(entries_, etag, &Entry::etag);
  if (found == entries_.end()) return nullptr;
  entries_.splice(entries_.begin(), entries_, found);
  return found->body;
}

void RenderCache::add(const std::string& etag, std::shared_ptr<const std::string> body) {
  const std::lock_guard lock(mutex_);
  used_bytes_ += body->size();
  entries_.push_front({etag, std::move(body)});
  while (used_bytes_ > budget_bytes_ && entries_.size() > 1) {
    used_bytes_ -= entries_.back().body->size();
    entries_.pop_back();
  }
}

Routes::Routes(const LinkOptions& options, std::shared_ptr<LinkBackend> backend, EventHub& events, bool tls,
               bool has_token, std::function<HttpCounters()> counters,
               std::function<std::string()> fallback_host, std::function<void()> wake_streams)
    : options_(options),
      backend_(std::move(backend)),
      events_(events),
      tls_(tls),
      has_token_(has_token),
      counters_(std::move(counters)),
      fallback_host_(std::move(fallback_host)),
      views_(options.overzoom),
      cache_(kRenderCacheBytes),
      previews_(*backend_, std::move(wake_streams)) {}

std::string Routes::baseUrl(const Request& request) const {
  return std::string(tls_ ? "https://" : "http://") + safeHost(request.header("host"), fallback_host_()) +
         request.prefix;
}

std::optional<Mission> Routes::currentMission() const {
  for (auto& mission : backend_->missions())
    if (mission.current) return mission;
  return std::nullopt;
}

Response Routes::failure(const Error& error) {
  int status = 500;
  switch (error.code) {
    case ErrorCode::BadInput:
      status = 400;
      break;
    case ErrorCode::NotFound:
      status = 404;
      break;
    case ErrorCode::Unsupported:
      status = 501;
      break;
    case ErrorCode::Unavailable:
    case ErrorCode::Io:
      status = 503;
      break;
    case ErrorCode::Corrupt:  // is being made again; the next request may find it
    case ErrorCode::BadSettings:
    case ErrorCode::Internal:
      break;
  }
  return Response::text(status, error.message + "\n");
}

Response Routes::conditional(const Request& request, const std::string& etag,
                             const std::function<Response()>& make) {
  Response out;
  if (etagListed(request.header("if-none-match"), etag)) {
    out.status = 304;
  } else {
    out = make();
    if (out.status >= 400) return out;
  }
  out.headers.emplace_back("ETag", etag);
  out.headers.emplace_back("Cache-Control", "no-cache");
  return out;
}

Response Routes::answer(Request request) {
  const auto missions_now = backend_->missions();
  const Mission* mission = nullptr;
  if (const auto split = splitMissionPath(request.path)) {
    const auto found = std::ranges::find(missions_now, split->token, &Mission::id);
    if (found == missions_now.end()) return Response::text(404, "There is no such mission; see /missions.\n");
    mission = &*found;
    request.prefix += "/m/" + mission->id;
    request.path = std::string(split->rest);
  } else if (const auto found = std::ranges::find_if(missions_now, &Mission::current);
             found != missions_now.end()) {
    mission = &*found;
  }

  const auto& path = request.path;
  if (path == "/missions") return request.method == Method::Get ? missions(request) : changeMission(request);
  const bool writes_plan =
      path == "/plan" && (request.method == Method::Put || request.method == Method::Delete);
  if (request.method != Method::Get && !writes_plan) {
    auto out = Response::text(405, "This URL is only for reading.\n");
    out.headers.emplace_back("Allow", path == "/plan" ? "GET, HEAD, PUT, DELETE" : "GET, HEAD");
    return out;
  }
  if (path == "/healthz") return health();
  if (path == "/metrics") return metrics();
  if (path == "/status") return status();
  if (path == "/front") return front();
  const bool of_map = path.starts_with("/tiles") || path == "/wmts" || path.starts_with("/wmts/") ||
                      path == "/height" || path == "/changes" || path == "/bundle" || path == "/events" ||
                      path == "/track" || path == "/plan" || path == "/coverage.json" ||
                      path == "/preview.jpg" || path == "/preview/stream";
  if (!of_map) return page(request);
  if (!mission) return Response::text(503, "There is no map yet; it begins with the first frame.\n");
  auto view = views_.lease(mission->map);
  if (!view) {
    // a mission whose file is still to be made is a map that is still empty, not a wrong address
    if (view.error().code == ErrorCode::NotFound) view.error().code = ErrorCode::Unavailable;
    return failure(view.error());
  }
  return onMap({request, *mission, **view});
}

Response Routes::onMap(const Visit& visit) {
  const auto& path = visit.request.path;
  if (const auto tile_path = parseTilePath(path))
    return tile_path->layer == "coverage" ? coverageTile(visit, *tile_path) : tile(visit, *tile_path);
  if (path == "/tiles" || path == "/tiles/" || path == "/tiles.json") return layerList(visit);
  if (path.starts_with("/tiles/") && path.ends_with(".json"))
    return layerDocument(visit, path.substr(7, path.size() - 12));
  if (path == "/wmts" || path.starts_with("/wmts/")) return wmts(visit);
  if (path == "/height") return height(visit);
  if (path == "/changes") return changes(visit);
  if (path == "/bundle") return bundle(visit);
  if (path == "/events") return events(visit);
  if (path == "/track") return track(visit);
  if (path == "/plan") return plan(visit);
  if (path == "/coverage.json") return coverage(visit);
  if (path == "/preview.jpg" || path == "/preview/stream") {
    const auto view = previewViewOf(visit.request.query, backend_->previewLimits());
    if (!view) return failure(view.error());
    if (path == "/preview/stream") return previews_.stream(visit.mission, *view);
    auto jpeg = previews_.single(visit.mission, *view);
    if (!jpeg) {
      auto out = failure(jpeg.error());
      if (out.status == 503) out.headers.emplace_back("Retry-After", "1");
      return out;
    }
    auto out = Response::text(200, std::move(*jpeg), "image/jpeg");
    out.headers.emplace_back("Cache-Control", "no-store");
    return out;
  }
  return Response::text(404, "There is no such tile: /tiles/LAYER/Z/X/Y.EXT, 0 <= z <= 30.\n");
}

}  // namespace overfly::link
