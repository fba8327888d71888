#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "daemon/link/bundle.h"
#include "daemon/link/detail/routes.h"

namespace overfly::link {
namespace {

constexpr std::size_t kPage = 256;         // changes read from the store at once
constexpr std::size_t kEventTiles = 2000;  // tiles named in one event; more is a resync
const tiling::ChangeFilter kEventFilter{
    .box = {}, .layers = tiling::kLinkLayers, .min_zoom = 0, .max_zoom = 63};

// What /changes and /bundle have in common.
struct Wish {
  tiling::ChangeFilter filter;
  std::size_t max_bytes = 0;
};

std::optional<Wish> parseWish(const Request& request, const MapView& view, const LinkOptions& options,
                              const char* budget_name, std::string& problem) {
  Wish wish;
  wish.filter.layers = tiling::kLinkLayers;
  if (const auto layers = request.arg("layers")) {
    const auto set = parseLayers(*layers);
    if (!set) {
      problem = "layers: a comma-separated list of color, elevation, elevation_max, quality";
      return std::nullopt;
    }
    wish.filter.layers = *set & tiling::kLinkLayers;
  }
  if (const auto text = request.arg("bbox")) {
    const auto box = parseBox(*text);
    if (!box) {
      problem = "bbox: west,south,east,north in degrees";
      return std::nullopt;
    }
    wish.filter.box = view.planeBox(*box);
    if (!wish.filter.box) wish.filter.box = tiling::PlaneBox{-9, -9, -9, -9};  // nothing lies there
  }
  for (const auto& [name, target] :
       {std::pair("minzoom", &wish.filter.min_zoom), {"maxzoom", &wish.filter.max_zoom}}) {
    const auto text = request.arg(name);
    if (!text) continue;
    const auto zoom = parseCount(*text);
    if (!zoom || *zoom > 63) {
      problem = std::string(name) + ": a zoom of the store's tiles";
      return std::nullopt;
    }
    *target = static_cast<int>(*zoom);
  }
  wish.max_bytes = options.max_bundle_bytes;
  if (const auto text = request.arg(budget_name)) {
    const auto bytes = parseCount(*text);
    if (!bytes || *bytes == 0) {
      problem = std::string(budget_name) + ": a number of bytes";
      return std::nullopt;
    }
    wish.max_bytes = std::min<std::size_t>(wish.max_bytes, *bytes);
  }
  return wish;
}

// A cursor belongs to one map: on a new flight a mirror must begin anew, not go on at a number that means
// something else. Clients name the map that their cursor is from.
std::optional<Response> otherMap(const Request& request, const tiling::MapMeta& meta) {
  const auto map = request.arg("map");
  if (!map || *map == meta.id) return std::nullopt;
  return Response::text(409, "The current map is " + meta.id + "; begin with since=0, or ask /m/MISSION/.\n");
}

void addCursor(Response& response, const tiling::MapMeta& meta, const std::string& cursor, bool done) {
  response.headers.emplace_back("Overfly-Map", meta.id);
  response.headers.emplace_back("Overfly-Cursor", cursor);
  response.headers.emplace_back("Overfly-Done", done ? "1" : "0");
  response.headers.emplace_back("Cache-Control", "no-cache");
}

std::string changeLine(const MapView& view, const tiling::Change& change) {
  const auto key = view.lattice().wrapped(change.key);
  auto line = fmt::format(R"({{"layer":"{}","z":{},"x":{},"y":{},"rev":{},"bytes":{})",
                          tiling::name(change.layer), key.zoom, key.x, key.y, change.revision, change.bytes);
  if (key.x != change.key.x) line += fmt::format(R"(,"ux":{})", change.key.x);
  if (change.erased) line += R"(,"erased":true)";
  return line + "}\n";
}

// [["color",z,x,y,revision],...] as the link's clients number tiles.
nlohmann::json eventTiles(const MapView& view, const std::vector<tiling::Change>& changes) {
  auto out = nlohmann::json::array();
  for (const auto& change : changes) {
    if (!tiling::contains(tiling::kLinkLayers, change.layer) || change.layer == tiling::Layer::ElevationMax)
      continue;
    const auto key = view.lattice().wrapped(change.key);
    out.push_back({tiling::name(change.layer), key.zoom, key.x, key.y, change.revision});
  }
  return out;
}

}  // namespace

Response Routes::changes(const Visit& visit) {
  const auto& [request, mission, view] = visit;
  if (auto refusal = otherMap(request, view.meta())) return *refusal;
  std::string problem;
  const auto wish = parseWish(request, view, options_, "max_bytes", problem);
  if (!wish) return Response::text(400, problem + "\n");
  auto cursor = tiling::ChangeCursor::parse(request.arg("since").value_or("0"));
  if (!cursor) return Response::text(400, "since: a revision, or the cursor of the last answer\n");
  if (mission.current && wish->filter.box && request.arg("bbox")) backend_->interest(*wish->filter.box);

  std::string body;
  while (!cursor->done && body.size() < wish->max_bytes) {
    // about 80 bytes a line: what fits in the rest, one tile at least
    const auto room = std::clamp<std::size_t>((wish->max_bytes - body.size()) / 80, 1, kPage);
    const auto page = view.reader().changes(*cursor, wish->filter, room);
    if (!page) return failure(page.error());
    for (const auto& change : page->changes) body += changeLine(view, change);
    cursor = page->next;
  }
  auto out = Response::text(200, body, "application/x-ndjson");
  addCursor(out, view.meta(), cursor->done ? std::to_string(cursor->until) : cursor->text(), cursor->done);
  return out;
}

Response Routes::bundle(const Visit& visit) {
  const auto& [request, mission, view] = visit;
  if (auto refusal = otherMap(request, view.meta())) return *refusal;
  if (const auto wanted = request.arg("tiles")) return bundleByName(visit, *wanted);
  std::string problem;
  const auto wish = parseWish(request, view, options_, "budget", problem);
  if (!wish) return Response::text(400, problem + "\n");
  const auto place = parseBundlePlace(request.arg("since").value_or("0"));
  if (!place) return Response::text(400, "since: a revision, a cursor, or CURSOR+BYTES@REVISION\n");

  auto cursor = place->cursor;
  std::string body;
  bool first = true;
  while (!cursor.done && body.size() < wish->max_bytes) {
    const auto page = view.reader().changes(cursor, wish->filter, 1);
    if (!page) return failure(page.error());
    cursor = page->next;
    if (page->changes.empty()) continue;
    TileRecord record;
    record.key = page->changes[0].key;
    record.since = cursor.since;
    record.until = cursor.until;
    const auto info = view.reader().info(record.key);
    if (!info || info->revision > cursor.until) continue;  // changed again: it comes in the next list
    record.revision = info->revision;
    record.gsd_m = info->gsd_m;
    record.provisional = info->provisional;
    for (const auto& change : page->changes) {
      tiling::StoredLayer layer;
      layer.encoded.layer = change.layer;
      layer.revision = change.revision;
      if (!change.erased) {
        auto stored = view.reader().read(change.key, change.layer);
        if (!stored) {
          // damaged on disk: it is made anew and comes with a later revision
          if (stored.error().code == ErrorCode::NotFound || stored.error().code == ErrorCode::Corrupt)
            continue;
          return failure(stored.error());
        }
        layer = std::move(*stored);
      }
      record.layers.push_back(std::move(layer));
    }
    auto bytes = encodeRecord(record);
    if (first && place->bytes > 0 && place->bytes < bytes.size() && place->revision == record.revision)
      bytes.erase(0, place->bytes);
    first = false;
    body += bytes;
  }
  auto out = Response::text(200, std::move(body), "application/x-overfly-bundle");
  addCursor(out, view.meta(), cursor.done ? std::to_string(cursor.until) : cursor.text(), cursor.done);
  return out;
}

Response Routes::bundleByName(const Visit& visit, const std::string& text) {
  const auto& [request, mission, view] = visit;
  const auto wanted = parseWanted(text);
  if (!wanted) return Response::text(400, "tiles: LAYER/Z/X/Y[+BYTES@REVISION];... (at most 512)\n");
  std::string body;
  for (const auto& one : *wanted) {
    if (body.size() >= options_.max_bundle_bytes) break;
    if (!tiling::contains(tiling::kLinkLayers, one.layer)) continue;
    TileRecord record;
    record.key = one.key;
    tiling::StoredLayer layer;
    auto stored = view.reader().read(one.key, one.layer);
    if (stored) {
      layer = std::move(*stored);
    } else if (stored.error().code == ErrorCode::NotFound) {
      layer.encoded.layer = one.layer;  // erased since it was listed
    } else if (stored.error().code == ErrorCode::Corrupt) {
      continue;
    } else {
      return failure(stored.error());
    }
    record.revision = layer.revision;
    if (const auto info = view.reader().info(one.key)) {
      record.gsd_m = info->gsd_m;
      record.provisional = info->provisional;
    }
    record.layers.push_back(std::move(layer));
    auto bytes = encodeRecord(record);
    if (one.bytes > 0 && one.bytes < bytes.size() && one.revision == record.revision)
      bytes.erase(0, one.bytes);
    body += bytes;
  }
  auto out = Response::text(200, std::move(body), "application/x-overfly-bundle");
  out.headers.emplace_back("Overfly-Map", view.meta().id);
  out.headers.emplace_back("Cache-Control", "no-cache");
  return out;
}

Response Routes::events(const Visit& visit) {
  const auto& [request, mission, view] = visit;
  const auto position = events_.position();
  const auto revision = view.reader().revision();
  if (!revision) return failure(revision.error());
  const auto& map = view.meta().id;
  const auto hello = nlohmann::json{{"map", map}, {"mission", mission.id}, {"revision", *revision}}.dump();
  auto first = EventHub::format("hello", "", hello);

  // "REVISION/MAP", as the events' ids are; a bare revision is one of the current map
  auto last = request.header("last-event-id");
  if (last.empty()) last = request.arg("since").value_or("");
  if (!last.empty()) {
    const auto slash = last.find('/');
    const auto since = parseCount(std::string_view(last).substr(0, slash));
    const bool same_map = slash == std::string::npos || last.substr(slash + 1) == map;
    if (!since || !same_map || *since > *revision) {
      first += EventHub::format("resync", "", "{}");
    } else if (*since < *revision) {
      const auto page =
          view.reader().changes({.since = *since, .until = *revision}, kEventFilter, kEventTiles);
      if (page && page->next.done) {
        first += EventHub::format(
            "change", fmt::format("{}/{}", *revision, map),
            nlohmann::json{{"map", map}, {"revision", *revision}, {"tiles", eventTiles(view, page->changes)}}
                .dump());
      } else {
        first += EventHub::format("resync", "", "{}");
      }
    }
  }
  Response out;
  out.headers.emplace_back("Content-Type", "text/event-stream");
  out.headers.emplace_back("Cache-Control", "no-store");
  out.headers.emplace_back("X-Accel-Buffering", "no");
  out.stream = events_.subscribe(std::move(first), request.arg("status").has_value(), position);
  return out;
}

void Routes::look() {
  const auto mission = currentMission();
  if (!mission) return;
  const auto lease = views_.lease(mission->map);
  if (!lease) return;
  const auto& view = **lease;
  const auto revision = view.reader().revision();
  if (!revision) return;
  const auto& map = view.meta().id;
  if (map != seen_mission_) {
    const bool first_look = seen_mission_.empty();
    seen_mission_ = map;
    seen_revision_ = *revision;
    if (!first_look)
      events_.publish(EventHub::Kind::Change, "mission", fmt::format("{}/{}", *revision, map),
                      nlohmann::json{{"map", map}, {"mission", mission->id}, {"revision", *revision}}.dump());
    return;
  }
  if (*revision <= seen_revision_) return;
  const auto page =
      view.reader().changes({.since = seen_revision_, .until = *revision}, kEventFilter, kEventTiles);
  if (!page) return;
  const auto id = fmt::format("{}/{}", *revision, map);
  if (page->next.done)
    events_.publish(
        EventHub::Kind::Change, "change", id,
        nlohmann::json{{"map", map}, {"revision", *revision}, {"tiles", eventTiles(view, page->changes)}}
            .dump());
  else
    events_.publish(EventHub::Kind::Change, "resync", id, "{}");
  seen_revision_ = *revision;
}

void Routes::publishStatus() {
  if (events_.statusWanted()) events_.publish(EventHub::Kind::Status, "status", "", statusText());
}

}  // namespace overfly::link
