#include "daemon/pull/puller.h"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "daemon/pull/event_parser.h"
#include "daemon/pull/mirror_writer.h"
#include "daemon/pull/record_stream.h"
#include "daemon/pull/remote_map.h"
#include "daemon/pull/want_list.h"

namespace overfly::pull {
namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr std::uint64_t kFirstList = 4096, kList = 16384;  // bytes of a page of /changes
constexpr std::uint64_t kLeastRequest = 8 * 1024, kMostRequest = 512 * 1024;
constexpr double kRequestTime_s = 2;     // worth of a connection's share that one request asks for
constexpr std::size_t kMostNames = 100;  // in one request: a few kB of URL
constexpr auto kPoll = 2s;               // between two looks at the list without events
constexpr double kEventSilence_s = 40;   // two heartbeats and a blackout
constexpr auto kLookAge = 10s, kLookPause = 3s;

double secondsSince(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

std::string layerNames(tiling::LayerSet layers) {
  std::string out;
  for (const auto layer : tiling::kLayers)
    if (tiling::contains(layers, layer)) out += (out.empty() ? "" : ",") + std::string(tiling::name(layer));
  return out;
}

}  // namespace

struct Puller::Impl {
  PullOptions options;
  std::string base;  // URL without the last slash
  Transfers transfers;

  // shared with other threads
  mutable std::mutex mutex;
  PullStatus shown;
  std::deque<std::pair<Clock::time_point, geo::TileKey>> looks;
  bool looks_changed = false;
  std::atomic<bool> stopping{false};

  std::function<void()> committed;

  // run()'s own from here on
  PullStatus now;
  std::optional<Error> fatal;
  RemoteMap remote;
  std::optional<geo::TileLattice> lattice;
  MirrorWriter writer;
  WantList wants;
  tiling::LayerSet layers = 0;
  bool x_is_unwrapped = false;  // the map lies across the antimeridian: events' tile numbers do not name keys

  std::string list_cursor;
  bool listing = false, list_done = false, first_list = true;
  bool other_map = false;       // an event spoke of another one
  bool list_was_empty = false;  // the last list had nothing: everything is known of
  std::uint64_t listed_revision = 0;
  Clock::time_point next_poll = Clock::now();

  bool contacting = false, hearing = false;
  int requests = 0;              // data transfers under way
  std::uint64_t generation = 0;  // answers for an earlier map are passed over
  std::string last_event;
  int failures = 0;
  Clock::time_point retry_at = Clock::now(), events_retry_at = retry_at, last_answer = retry_at;

  std::map<LayerKey, Begun> begun;  // of answers that broke off

  std::deque<std::pair<std::uint64_t, Clock::time_point>> announced;  // revision, when it was heard of
  Clock::time_point rated_at = Clock::now(), look_list_at = rated_at - kLookPause;
  std::uint64_t rated_bytes = 0;

  explicit Impl(PullOptions o)
      : options(std::move(o)),
        transfers({.token = options.token, .ca_file = options.ca_file, .connections = options.connections}) {
    base = options.url.find("://") == std::string::npos ? "http://" + options.url : options.url;
    while (base.ends_with('/')) base.pop_back();
    now.problem = "no answer yet";
  }

  [[nodiscard]] int dataConnections() const {
    return options.once || options.connections < 2 ? std::max(1, options.connections)
                                                   : options.connections - 1;
  }

  // ---- contact ----

  void begin() {
    if (contacting || Clock::now() < retry_at) return;
    contacting = true;
    auto text = std::make_shared<std::string>();
    transfers.start({.url = base + "/tiles.json",
                     .headers = {},
                     .stall_time_s = options.stall_time_s,
                     .data = [text](std::string_view part) { text->append(part); },
                     .end =
                         [this, text](const TransferEnd& end) {
                           contacting = false;
                           if (!judge(end)) return;
                           auto map = parseRemoteMap(*text);
                           if (!map) {
                             fatal = map.error();
                             return;
                           }
                           adopt(std::move(*map));
                         }});
  }

  void adopt(RemoteMap map) {
    auto opened = options.target.extension() == ".mbtiles" ? openMbTilesMirror(options.target, map)
                                                           : openMapMirror(options.target, map);
    if (!opened) {
      fatal = opened.error();
      return;
    }
    lattice = *geo::TileLattice::parse(map.meta.lattice);
    remote = std::move(map);
    writer.open(std::move(*opened));
    layers = options.layers & writer.mirror().layers() & tiling::kLinkLayers;
    list_cursor = writer.mirror().cursor();
    last_event.clear();
    ++generation;
    now.mission = remote.mission;
    now.map = remote.id;
    now.mirror = writer.mirror().path();
    announce(remote.revision);
    if (committed) committed();
  }

  // Another map has taken its place: this one stays as it is.
  void leave() {
    wants.clear();
    writer.close();
    begun.clear();
    announced.clear();
    listing = list_done = list_was_empty = x_is_unwrapped = other_map = false;
    first_list = true;
    listed_revision = now.revision = 0;
    ++generation;
  }

  // Of every answer: true when it is one to use. Sets what stands in the way otherwise.
  bool judge(const TransferEnd& end) {
    if (end.status == 200 && end.whole) {
      failures = 0;
      last_answer = Clock::now();
      now.connected = true;
      now.problem.clear();
      return true;
    }
    if (end.status == 401)
      fatal = Error{
          ErrorCode::BadSettings,
          "the drone asks for a token: give the URL with /t/TOKEN/, or the token's file by --token-file"};
    if (end.status == 421)
      fatal = Error{ErrorCode::BadSettings,
                    "the drone does not answer to that name; use its IP address, or a token"};
    if (end.status == 404 && !writer.isOpen())
      fatal = Error{ErrorCode::BadSettings,
                    "there is no map of overfly at that URL; it is the one that overflyd prints"};
    if (end.status == 409) {
      if (commit()) leave();
      return false;
    }
    ++failures;
    if (end.status == 0 || end.status == 200) ++now.reconnects;
    now.connected = end.status >= 300;
    if (end.status >= 300) last_answer = Clock::now();
    now.problem = end.status == 503   ? "the drone has no map yet"
                  : end.status >= 300 ? fmt::format("the drone answers {}", end.status)
                                      : end.problem;
    const auto pause = std::min(2000ms, 125ms * (1 << std::min(failures, 5)));
    retry_at = Clock::now() + pause;
    return false;
  }

  // ---- what there is ----

  void announce(std::uint64_t revision) {
    if (revision <= now.revision) return;
    now.revision = revision;
    announced.emplace_back(revision, Clock::now());
  }

  [[nodiscard]] std::string common() const {
    return "map=" + percentEncoded(remote.id) + "&layers=" + layerNames(layers);
  }

  void list() {
    if (listing) return;
    if (list_done) {
      const bool news = now.revision > listed_revision || (other_map && Clock::now() >= next_poll);
      const bool confirm = options.once && !list_was_empty && wants.waiting() + wants.inFlight() == 0;
      const bool poll = !options.once && !hearing && Clock::now() >= next_poll;
      if (!news && !confirm && !poll) return;
    } else if (wants.waitingBytes() > requestBytes() * static_cast<std::uint64_t>(dataConnections()) * 2) {
      return;  // enough to go on with: coarse levels before more of the list
    }
    listing = true;
    other_map = false;
    ++requests;
    next_poll = Clock::now() + kPoll;
    auto text = std::make_shared<std::string>();
    const auto from = generation;
    transfers.start(
        {.url = fmt::format("{}/changes?since={}&max_bytes={}&{}", base, percentEncoded(list_cursor),
                            first_list ? kFirstList : kList, common()),
         .headers = {},
         .stall_time_s = options.stall_time_s,
         .data = [text](std::string_view part) { text->append(part); },
         .end =
             [this, text, from](const TransferEnd& end) {
               --requests;
               listing = listing && from != generation;
               if (!judge(end) || from != generation) return;
               first_list = false;
               const auto cursor = end.header("overfly-cursor");
               const auto parsed = tiling::ChangeCursor::parse(cursor);
               if (!parsed) return;
               const auto page = takeList(*text);
               list_done = end.header("overfly-done") == "1";
               list_was_empty = list_done && page.empty() && text->empty();
               listed_revision = list_done ? parsed->since : 0;
               announce(list_done ? parsed->since : parsed->until);
               list_cursor = cursor;
               wants.addPage(cursor, page);
             }});
  }

  // Lines of /changes; what is gone goes into the mirror at once.
  std::vector<Listed> takeList(const std::string& text) {
    std::vector<Listed> out;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) {
      const auto change = parseChange(line);
      if (!change) continue;
      x_is_unwrapped = x_is_unwrapped || change->unwrapped;
      learn(change->listed.what);
      if (!change->erased) {
        out.push_back(change->listed);
      } else if (wants.revisionOf(change->listed.what) < change->listed.revision) {
        link::TileRecord gone;
        gone.key = change->listed.what.key;
        gone.layers.push_back(
            {{change->listed.what.layer, tiling::Codec::Erased, {}, {}}, change->listed.revision});
        wants.have(change->listed.what, change->listed.revision);
        writer.keep(std::move(gone));
      }
    }
    return out;
  }

  // What the mirror knows of a layer from earlier runs.
  void learn(const LayerKey& what) {
    if (wants.revisionOf(what) == 0)
      if (const auto revision = writer.mirror().revisionOf(what)) wants.have(what, revision);
  }

  void listen() {
    if (options.once || options.connections < 2 || hearing || Clock::now() < events_retry_at) return;
    hearing = true;
    auto parser = std::make_shared<EventParser>(
        [this](const std::string& event, const std::string& id, const std::string& data) {
          if (writer.isOpen()) heard(event, id, data);
        });
    std::vector<std::string> headers;
    if (!last_event.empty()) headers.push_back("Last-Event-ID: " + last_event);
    transfers.start({.url = base + "/events",
                     .headers = std::move(headers),
                     .stall_time_s = kEventSilence_s,
                     .data = [parser](std::string_view part) { parser->feed(part); },
                     .end =
                         [this](const TransferEnd&) {
                           hearing = false;
                           next_poll = Clock::now();
                           events_retry_at = Clock::now() + 1s;
                         }});
  }

  void heard(const std::string& event, const std::string& id, const std::string& data) {
    last_answer = Clock::now();
    if (!id.empty()) last_event = id;
    const auto node = nlohmann::json::parse(data, nullptr, false);
    if (!node.is_object()) return;
    if (node.contains("map") && node["map"].is_string() && node["map"] != remote.id) {
      other_map = true;  // the next list's answer says whether it took the place of this one
      return;
    }
    if (event == "resync") now.revision = std::max(now.revision, listed_revision + 1);
    if (node.contains("revision") && node["revision"].is_number_unsigned())
      announce(node["revision"].get<std::uint64_t>());
    if (event != "change" || x_is_unwrapped || !node.contains("tiles")) return;
    for (const auto& tile : node["tiles"])
      if (const auto named = parseEventTile(tile); named && tiling::contains(layers, named->what.layer)) {
        learn(named->what);
        wants.add(*named);
      }
  }

  // ---- tiles ----

  [[nodiscard]] std::uint64_t requestBytes() const {
    const auto share = now.bytes_per_s * kRequestTime_s / dataConnections();
    return std::clamp(static_cast<std::uint64_t>(share), kLeastRequest, kMostRequest);
  }

  void fetch() {
    while (requests < dataConnections() && wants.waiting() > 0 && !writer.isFull()) {
      // The last bytes are shared out, so that no connection idles while another has a long request.
      const auto fair = wants.waitingBytes() / static_cast<std::uint64_t>(dataConnections()) + 1;
      fetch(wants.take(std::min(requestBytes(), fair), kMostNames));
    }
  }

  struct Request {
    std::vector<Listed> asked;  // those that have not come yet, in the order asked
    RecordStream stream;
    std::size_t came = 0;
    bool broken = false;
    std::uint64_t generation = 0;
  };

  void fetch(std::vector<Listed> asked) {
    auto request = std::make_shared<Request>();
    request->generation = generation;
    std::string names;
    std::deque<Begun> parts;
    for (const Listed& one : asked) {
      link::WantedTile wanted{one.what.layer, one.what.key};
      if (auto part = begun.extract(one.what)) {
        wanted.bytes = part.mapped().bytes.size();
        wanted.revision = part.mapped().revision;
        parts.push_back(std::move(part.mapped()));
      }
      names += (names.empty() ? "" : ";") + link::text(wanted);
    }
    request->stream = RecordStream(std::move(parts));
    request->asked = std::move(asked);
    ++requests;
    transfers.start({.url = fmt::format("{}/bundle?map={}&tiles={}", base, percentEncoded(remote.id),
                                        percentEncoded(names)),
                     .headers = {},
                     .stall_time_s = options.stall_time_s,
                     .data = [this, request](std::string_view part) { receive(*request, part); },
                     .end = [this, request](const TransferEnd& end) { conclude(*request, end); }});
  }

  void receive(Request& request, std::string_view part) {
    if (request.broken || request.generation != generation) return;
    auto records = request.stream.feed(part);
    if (!records) {
      request.broken = true;
      now.problem = records.error().message;
      return;
    }
    for (auto& record : *records) {
      if (record.layers.size() != 1) continue;
      auto& layer = record.layers[0];
      const LayerKey what{record.key, layer.encoded.layer};
      const auto asked =
          std::ranges::find_if(request.asked, [&](const Listed& one) { return one.what == what; });
      if (asked == request.asked.end()) continue;
      // Answers come in the order asked: what was passed over cannot be read at the drone, and comes with a
      // later revision when it has been made anew.
      for (auto one = request.asked.begin(); one != asked; ++one) wants.done(one->what, 0, 0);
      const auto revision = layer.revision;
      if (revision == 0) layer.revision = asked->revision;  // gone since it was listed
      request.asked.erase(request.asked.begin(), asked + 1);
      ++request.came;
      wants.done(what, revision, layer.encoded.bytes.size() + link::kRecordHead + link::kLayerHead);
      ++now.layers;
      writer.keep(std::move(record));
    }
  }

  void conclude(Request& request, const TransferEnd& end) {
    --requests;
    if (request.generation != generation) return;
    const bool whole = judge(end) && !request.broken;
    if (request.generation != generation) return;  // the map was left
    now.resumed_bytes += request.stream.resumed();
    if (!whole && !request.broken)
      for (auto& part : request.stream.parts()) begun.insert_or_assign(part.what, std::move(part));
    if (whole && request.came == 0 && !request.asked.empty()) {
      wants.done(request.asked.front().what, 0, 0);  // cannot be read at the drone
      request.asked.erase(request.asked.begin());
    }
    for (const Listed& one : request.asked) wants.giveBack(one.what);
  }

  // ---- the mirror ----

  bool commit() {
    if (auto cursor = wants.cursor()) writer.keepCursor(std::move(*cursor));
    const auto wrote = writer.commit();
    if (!wrote) {
      now.problem = wrote.error().message;
      return false;
    }
    if (*wrote && committed) committed();
    return true;
  }

  void commitIfDue() {
    if (auto cursor = wants.cursor()) writer.keepCursor(std::move(*cursor));
    if (writer.isDue(wants.waiting() + wants.inFlight() == 0)) (void)commit();
  }

  // ---- looking ----

  void look() {
    std::vector<geo::TileKey> tiles;
    bool changed = false;
    {
      const std::lock_guard lock(mutex);
      while (!looks.empty() && Clock::now() - looks.front().first > kLookAge) {
        looks.pop_front();
        looks_changed = true;
      }
      changed = std::exchange(looks_changed, false);
      if (changed)
        for (const auto& [at, key] : looks) tiles.push_back(key);
    }
    if (!changed) return;
    std::ranges::sort(tiles);
    tiles.erase(std::unique(tiles.begin(), tiles.end()), tiles.end());
    wants.lookAt(tiles);
    if (tiles.empty() || Clock::now() - look_list_at < kLookPause || requests >= dataConnections()) return;
    look_list_at = Clock::now();
    listBox(tiles);
  }

  // What changed where somebody looks, ahead of the list's order; the drone hears of the place by it, too.
  void listBox(const std::vector<geo::TileKey>& tiles) {
    const auto finest = std::ranges::max(tiles, {}, &geo::TileKey::zoom).zoom;
    std::optional<tiling::PlaneBox> box;
    for (const auto& key : tiles) {
      if (key.zoom != finest) continue;
      const auto nw = geo::TileLattice::planeOf(key), se = geo::TileLattice::planeOf(key, 1, 1);
      if (!box) box = tiling::PlaneBox{nw.x(), nw.y(), se.x(), se.y()};
      box = {std::min(box->west, nw.x()), std::min(box->north, nw.y()), std::max(box->east, se.x()),
             std::max(box->south, se.y())};
    }
    const auto nw = lattice->geodeticFromPlane({box->west, box->north});
    const auto se = lattice->geodeticFromPlane({box->east, box->south});
    const auto since = tiling::ChangeCursor::parse(writer.mirror().cursor());
    ++requests;
    auto text = std::make_shared<std::string>();
    const auto from = generation;
    transfers.start(
        {.url = fmt::format("{}/changes?since={}&max_bytes={}&bbox={:.7f},{:.7f},{:.7f},{:.7f}&{}", base,
                            since ? since->since : 0, kList, geo::degrees(nw.lon), geo::degrees(se.lat),
                            geo::degrees(se.lon), geo::degrees(nw.lat), common()),
         .headers = {},
         .stall_time_s = options.stall_time_s,
         .data = [text](std::string_view part) { text->append(part); },
         .end =
             [this, text, from](const TransferEnd& end) {
               --requests;
               if (!judge(end) || from != generation) return;
               for (const Listed& one : takeList(*text)) wants.add(one);
             }});
  }

  // ---- telling ----

  void tell(const std::function<void(const PullStatus&)>& tick) {
    const auto elapsed = secondsSince(rated_at);
    if (elapsed < 0.2) return;
    now.bytes = transfers.bytes();
    const auto rate = static_cast<double>(now.bytes - rated_bytes) / elapsed;
    const auto weight = std::min(1.0, elapsed / 3);
    now.bytes_per_s += weight * (rate - now.bytes_per_s);
    rated_at = Clock::now();
    rated_bytes = now.bytes;
    now.wanted = wants.waiting() + wants.inFlight();
    now.wanted_bytes = wants.waitingBytes();
    now.complete = complete();
    if (now.complete) announced.clear();
    auto needed = wants.wantedRevision();
    if (!list_done) needed = std::min(needed == 0 ? UINT64_MAX : needed, listSince() + 1);
    if (needed != 0)
      while (announced.size() > 1 && announced.front().first < needed) announced.pop_front();
    now.lag_s = announced.empty() ? 0 : secondsSince(announced.front().second);
    {
      const std::lock_guard lock(mutex);
      shown = now;
    }
    tick(now);
  }

  [[nodiscard]] std::uint64_t listSince() const {
    const auto cursor = tiling::ChangeCursor::parse(list_cursor);
    return cursor ? cursor->since : 0;
  }

  [[nodiscard]] bool complete() const {
    return writer.isOpen() && list_done && now.revision <= listed_revision &&
           wants.waiting() + wants.inFlight() == 0 && writer.isEmpty();
  }

  Result<void> run(const std::function<void(const PullStatus&)>& tick) {
    last_answer = Clock::now();
    while (!stopping) {
      if (!writer.isOpen()) {
        begin();
      } else {
        listen();
        look();
        if (Clock::now() >= retry_at) {
          if (requests < dataConnections()) list();
          fetch();
        }
      }
      transfers.run(50ms);
      commitIfDue();
      tell(tick);
      if (fatal) break;
      if (options.once && complete() && list_was_empty && requests == 0 && commit()) break;
      if (options.give_up_s > 0 && secondsSince(last_answer) > options.give_up_s) {
        (void)commit();
        return fail(
            ErrorCode::Unavailable,
            fmt::format("the drone has not answered for {:.0f} s ({}); what had come is kept, and the same "
                        "command goes on from there",
                        options.give_up_s, now.problem.empty() ? "silence" : now.problem));
      }
    }
    // What has come is kept in any case.
    if (!commit() && !fatal) fatal = Error{ErrorCode::Io, now.problem};
    rated_at -= 1s;
    tell(tick);
    if (fatal) return tl::unexpected(*fatal);
    return {};
  }
};

Puller::Puller(PullOptions options) : impl_(std::make_unique<Impl>(std::move(options))) {}
Puller::~Puller() = default;

Result<void> Puller::run(const std::function<void(const PullStatus&)>& tick) { return impl_->run(tick); }

void Puller::stop() {
  impl_->stopping = true;
  impl_->transfers.wake();
}

PullStatus Puller::status() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->shown;
}

void Puller::lookAt(const geo::TileKey& key) {
  constexpr std::size_t kMostLooks = 256;
  const std::lock_guard lock(impl_->mutex);
  if (impl_->looks.size() >= kMostLooks) impl_->looks.pop_front();
  impl_->looks.emplace_back(Clock::now(), key);
  impl_->looks_changed = true;
}

void Puller::onCommit(std::function<void()> listener) { impl_->committed = std::move(listener); }

}  // namespace overfly::pull
