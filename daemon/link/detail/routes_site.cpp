#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "daemon/link/detail/routes.h"
#include "daemon/page/assets.h"

namespace overfly::link {
namespace {

// The page runs no foreign code and talks to nobody else; MapLibre's workers are blobs of its own.
constexpr const char* kPolicy =
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; worker-src 'self' "
    "blob:; "
    "connect-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

nlohmann::json missionJson(const Mission& mission) {
  return {{"id", mission.id},
          {"name", mission.name},
          {"started_utc_ms", mission.started_utc_ns / 1000000},
          {"live", mission.live},
          {"current", mission.current}};
}

void replaceAll(std::string& text, std::string_view from, std::string_view to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
}

}  // namespace

Response Routes::missions(const Request&) {
  auto list = nlohmann::json::array();
  for (const auto& mission : backend_->missions()) list.push_back(missionJson(mission));
  auto out =
      Response::json(nlohmann::json{{"missions", list}, {"changeable", backend_->changesMissions()}}.dump());
  out.headers.emplace_back("Cache-Control", "no-cache");
  return out;
}

Response Routes::changeMission(const Request& request) {
  if (request.method == Method::Post) {
    std::string name;
    if (!request.body.empty()) {
      const auto node = nlohmann::json::parse(request.body, nullptr, false);
      if (!node.is_object() || !node.contains("name") || !node["name"].is_string())
        return Response::text(400, "POST {\"name\": \"...\"} starts a mission.\n");
      name = node["name"].get<std::string>();
    }
    const auto started = backend_->startMission(name);
    if (!started) return failure(started.error());
    return Response::json(missionJson(*started).dump(), 201);
  }
  if (request.method == Method::Delete) {
    if (const auto stopped = backend_->stopMission(); !stopped) return failure(stopped.error());
    return Response::text(204, "");
  }
  auto out = Response::text(405, "GET lists, POST starts, DELETE ends the mission.\n");
  out.headers.emplace_back("Allow", "GET, HEAD, POST, DELETE");
  return out;
}

std::string Routes::statusText() {
  auto node = nlohmann::json::parse(backend_->statusJson(), nullptr, false);
  if (!node.is_object()) node = nlohmann::json::object();
  const auto counters = counters_();
  node["link"] = {{"requests", counters.requests},   {"refused", counters.refused},
                  {"dropped", counters.dropped},     {"bytes", counters.bytes},
                  {"clients", counters.connections}, {"streams", counters.streams},
                  {"max_kbps", counters.max_kbps}};
  if (const auto mission = currentMission()) {
    node["mission"] = missionJson(*mission);
    if (const auto view = views_.lease(mission->map)) {
      const auto& reader = (*view)->reader();
      auto& map = node["map"];
      map["id"] = (*view)->meta().id;
      if (const auto revision = reader.revision()) map["revision"] = *revision;
      if (const auto statistics = reader.statistics()) {
        map["tiles"] = statistics->tiles;
        map["file_bytes"] = statistics->file_bytes + statistics->log_bytes;
        map["queued"] = statistics->queued;
        std::uint64_t frames = 0;
        for (const auto n : statistics->frames) frames += n;
        map["frames"] = frames;
        map["frames_mapped"] = statistics->frames[static_cast<int>(tiling::FrameState::Mapped)];
      }
    }
  }
  const auto health_now = backend_->health();
  node["health"] = {{"ok", health_now.ok}, {"reason", health_now.reason}};
  return node.dump();
}

Response Routes::status() {
  auto out = Response::json(statusText());
  out.headers.emplace_back("Cache-Control", "no-cache");
  return out;
}

Response Routes::front() {
  auto front = backend_->frontJson();
  if (!front) return failure(front.error());
  auto out = Response::json(std::move(*front));
  out.headers.emplace_back("Cache-Control", "no-cache");
  return out;
}

Response Routes::metrics() {
  const auto c = counters_();
  auto text = backend_->metricsText();
  const auto add = [&](const char* name, const char* kind, const char* help, std::uint64_t value) {
    text += fmt::format("# HELP overfly_link_{0} {1}\n# TYPE overfly_link_{0} {2}\noverfly_link_{0} {3}\n",
                        name, help, kind, value);
  };
  add("requests_total", "counter", "HTTP requests with a whole head", c.requests);
  add("refused_total", "counter", "requests without a valid token or host", c.refused);
  add("dropped_total", "counter", "connections closed for being too slow", c.dropped);
  add("sent_bytes_total", "counter", "payload and response heads", c.bytes);
  add("connections", "gauge", "open connections", c.connections);
  add("event_streams", "gauge", "open event streams", c.streams);
  return Response::text(200, std::move(text), "text/plain; version=0.0.4; charset=utf-8");
}

Response Routes::health() {
  const auto now = backend_->health();
  return Response::text(now.ok ? 200 : 503,
                        now.reason.empty() ? (now.ok ? "ok\n" : "not ok\n") : now.reason + "\n");
}

Response Routes::page(const Request& request) {
  const auto* asset = page::find(request.path == "/"          ? "/index.html"
                                 : request.path == "/connect" ? "/connect.html"
                                                              : request.path);
  if (!asset)
    return Response::text(404, "There is nothing here. The page is /, the layers are in /tiles.json.\n");
  const bool is_template = asset->path == "/connect.html";
  const bool takes_gzip = !is_template && request.header("accept-encoding").find("gzip") != std::string::npos;
  const auto make = [&] {
    Response out;
    out.headers.emplace_back("Content-Type", std::string(asset->media_type));
    out.headers.emplace_back("Vary", "Accept-Encoding");
    out.headers.emplace_back("Content-Security-Policy", kPolicy);
    if (takes_gzip) {
      out.headers.emplace_back("Content-Encoding", "gzip");
      out.body = std::make_shared<const std::string>(asset->gzipped);
    } else {
      auto text = page::unpacked(*asset);
      if (is_template) replaceAll(text, "{{BASE}}", escapeXml(baseUrl(request)));
      out.body = std::make_shared<const std::string>(std::move(text));
    }
    return out;
  };
  if (is_template) {
    auto out = make();
    out.headers.emplace_back("Cache-Control", "no-store");
    return out;
  }
  auto etag = std::string(asset->etag);
  if (takes_gzip) etag.insert(etag.size() - 1, "-gz");
  auto out = conditional(request, etag, make);
  // From here on the browser may leave the path's token out: pictures and streams send the cookie by
  // themselves.
  if (request.path == "/" && request.prefix.starts_with("/t/")) {
    const auto token = request.prefix.substr(3, request.prefix.find('/', 3) - 3);
    out.headers.emplace_back("Set-Cookie", "overfly_token=" + token + "; Path=/; HttpOnly; SameSite=Strict" +
                                               (tls_ ? "; Secure" : ""));
  }
  return out;
}

}  // namespace overfly::link
