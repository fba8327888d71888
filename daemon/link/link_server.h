#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "capture/geo/geodetic.h"
#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "daemon/link/link_options.h"
#include "tiling/store/map_store.h"

namespace overfly::link {

// A map that the link shows. The current one answers at /..., every one at /m/ID/...
struct Mission {
  std::string id;    // in URLs: letters, digits, '-', '_', '.'
  std::string name;  // for people
  std::filesystem::path map;
  std::int64_t started_utc_ns = 0;
  bool live = false;     // frames may still come
  bool current = false;  // exactly one, where there is any
};

struct Health {
  bool ok = true;
  std::string reason;  // one line, for people
};

// A picture of the map from any view point (docs/preview.md).
struct PreviewView {
  static constexpr int kMostPhotos = 8;
  geo::Geodetic position;                  // radians; metres in the map's datum
  double heading = 0, pitch = 0, fov = 1;  // radians: from north towards east, above the horizon, across
  int width = 0, height = 0;               // pixels
  int photos = 0;  // that colour steep sides, at most: 0 to kMostPhotos
};
struct PreviewPicture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  // row 0 at the top
};
// What a client may ask for.
struct PreviewLimits {
  int max_width = 1280, max_height = 720;
  double max_fps = 10;  // single pictures of all clients together; and of each stream
  int jpeg_quality = 80;
};

// What the link asks of whoever runs it. The defaults are those of a finished map that is only shown.
// Thread rule: called from several of the link's workers at once; must return within milliseconds.
class LinkBackend {
 public:
  virtual ~LinkBackend() = default;
  [[nodiscard]] virtual std::vector<Mission> missions() const = 0;

  // One JSON object; the link adds its own members under "link" and "map".
  [[nodiscard]] virtual std::string statusJson() const { return "{}"; }
  // Prometheus text, complete lines; the link adds its own.
  [[nodiscard]] virtual std::string metricsText() const { return {}; }
  [[nodiscard]] virtual Health health() const { return {}; }

  // A client looks here: tile of the current mission's store, or a box in its plane. What the scheduler may
  // put first.
  virtual void interest(const geo::TileKey& /*key*/) {}
  virtual void interest(const tiling::PlaneBox& /*box*/) {}

  // The map as it is at this moment. One call at a time; may take seconds, unlike the others. Unsupported:
  // nothing is drawn here; Unavailable: not now.
  [[nodiscard]] virtual Result<PreviewPicture> preview(const Mission& /*mission*/,
                                                       const PreviewView& /*view*/) {
    return fail(ErrorCode::Unsupported,
                "previews are drawn by the daemon on board, not from a map that is only shown");
  }
  [[nodiscard]] virtual PreviewLimits previewLimits() const { return {}; }

  // JSON: the points of accuracy against time that tiles may be made at (docs/link.md, /front). Unsupported:
  // no tiles are made here; Unavailable: not yet.
  [[nodiscard]] virtual Result<std::string> frontJson() const {
    return fail(ErrorCode::Unsupported,
                "tiles are made by the daemon on board, not where a map is only shown");
  }

  // Whether startMission() and stopMission() do anything.
  [[nodiscard]] virtual bool changesMissions() const { return false; }
  // Starts or ends a mission on a client's word; Unsupported where that is not for the link to do.
  [[nodiscard]] virtual Result<Mission> startMission(const std::string& /*name*/) {
    return fail(ErrorCode::Unsupported, "missions cannot be started here");
  }
  [[nodiscard]] virtual Result<void> stopMission() {
    return fail(ErrorCode::Unsupported, "missions cannot be stopped here");
  }
};

// The link: everything that leaves the machine (docs/link.md). Reads maps through connections of its own,
// so it neither waits for the mapping stages nor makes them wait.
//
// Thread rules: start() once; every other call from any thread. Threads: one epoll thread, `workers`
// workers, one clock, one that watches the current map's revision, one that draws streams of previews.
class LinkServer {
 public:
  LinkServer(LinkOptions options, std::shared_ptr<LinkBackend> backend);
  ~LinkServer();
  LinkServer(const LinkServer&) = delete;
  LinkServer& operator=(const LinkServer&) = delete;

  // BadSettings with one sentence: address taken, token missing or readable by others, TLS unusable.
  [[nodiscard]] Result<void> start();
  // Within a second; open requests end. Also run by the destructor.
  void stop();

  [[nodiscard]] std::uint16_t port() const;
  // "http://127.0.0.1:8420/", with the token's path where one is needed: for the operator's eyes, not a log.
  [[nodiscard]] std::string url() const;
  // A commit was made: events go out now instead of at the next look (every 200 ms). Cheap.
  void mapChanged();
  // The cap from now on (LinkOptions::max_kbps).
  void setMaxKbps(double kbps);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Shows finished maps, read-only (`overfly serve`, `overfly pull --serve`): the first one is current.
[[nodiscard]] std::shared_ptr<LinkBackend> showMaps(std::vector<Mission> missions);

}  // namespace overfly::link
