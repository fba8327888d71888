#pragma once
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/link/detail/coverage.h"
#include "daemon/link/detail/documents.h"
#include "daemon/link/detail/events.h"
#include "daemon/link/detail/http_server.h"
#include "daemon/link/detail/map_view.h"
#include "daemon/link/detail/previews.h"
#include "daemon/link/link_server.h"

namespace overfly::link {

// Open maps, one view per worker that is busy with it. Thread-safe; a lease is the thread's own.
class ViewPool {
 public:
  explicit ViewPool(int overzoom) : overzoom_(overzoom) {}
  struct Return {
    ViewPool* pool = nullptr;
    std::filesystem::path path;
    void operator()(MapView* view) const { pool->giveBack(path, view); }
  };
  using Lease = std::unique_ptr<MapView, Return>;
  [[nodiscard]] Result<Lease> lease(const std::filesystem::path& path);
  void forgetAllBut(const std::vector<Mission>& missions);

 private:
  void giveBack(const std::filesystem::path& path, MapView* view);
  const int overzoom_;
  std::mutex mutex_;
  std::map<std::filesystem::path, std::vector<std::unique_ptr<MapView>>> idle_;
};

// Rendered tiles by their ETag, within a byte budget. Thread-safe.
class RenderCache {
 public:
  explicit RenderCache(std::size_t budget_bytes) : budget_bytes_(budget_bytes) {}
  [[nodiscard]] std::shared_ptr<const std::string> find(const std::string& etag);
  void add(const std::string& etag, std::shared_ptr<const std::string> body);

 private:
  struct Entry {
    std::string etag;
    std::shared_ptr<const std::string> body;
  };
  const std::size_t budget_bytes_;
  std::size_t used_bytes_ = 0;
  std::mutex mutex_;
  std::list<Entry> entries_;  // most recent first
};

// What each URL answers. Reentrant: the workers share one.
class Routes {
 public:
  Routes(const LinkOptions& options, std::shared_ptr<LinkBackend> backend, EventHub& events, bool tls,
         bool has_token, std::function<HttpCounters()> counters, std::function<std::string()> fallback_host,
         std::function<void()> wake_streams);

  [[nodiscard]] Response answer(Request request);
  // No more previews; a stream of them ends. Waits for the picture that is being drawn.
  void stopPreviews() { previews_.stop(); }

  // One look at the current map: publishes what changed since the last one. On the watching thread alone.
  void look();
  // Status event for the streams that want it.
  void publishStatus();

 private:
  // A request on one mission's map.
  struct Visit {
    const Request& request;
    const Mission& mission;
    MapView& view;
  };
  Response onMap(const Visit& visit);

  // routes_tiles.cpp
  Response tile(const Visit& visit, const TilePath& path);
  Response layerDocument(const Visit& visit, const std::string& layer);
  Response layerList(const Visit& visit);
  Response wmts(const Visit& visit);
  Response height(const Visit& visit);
  [[nodiscard]] std::vector<LayerInfo> layers(const MapView& view) const;
  [[nodiscard]] DocumentContext documentContext(const Visit& visit) const;

  // routes_changes.cpp
  Response changes(const Visit& visit);
  Response bundle(const Visit& visit);
  Response bundleByName(const Visit& visit, const std::string& wanted);
  Response events(const Visit& visit);

  // routes_flight.cpp
  Response track(const Visit& visit);
  Response plan(const Visit& visit);
  Response coverage(const Visit& visit);
  Response coverageTile(const Visit& visit, const TilePath& path);
  struct Shots;
  std::shared_ptr<const Shots> shots(const Visit& visit);
  static std::filesystem::path planPath(const Mission& mission);
  static std::optional<std::string> readPlan(const Mission& mission);

  // routes_site.cpp
  Response missions(const Request& request);
  Response changeMission(const Request& request);
  Response status();
  Response front();
  Response metrics();
  Response health();
  Response page(const Request& request);
  [[nodiscard]] std::string statusText();

  [[nodiscard]] std::string baseUrl(const Request& request) const;
  // 304 when the client has it, else what `make` gives; adds ETag and Cache-Control.
  static Response conditional(const Request& request, const std::string& etag,
                              const std::function<Response()>& make);
  static Response failure(const Error& error);
  [[nodiscard]] std::optional<Mission> currentMission() const;

  const LinkOptions options_;
  const std::shared_ptr<LinkBackend> backend_;
  EventHub& events_;
  const bool tls_, has_token_;
  const std::function<HttpCounters()> counters_;
  const std::function<std::string()> fallback_host_;
  ViewPool views_;
  RenderCache cache_;
  Previews previews_;

  std::mutex shots_mutex_;
  std::map<std::string, std::shared_ptr<const Shots>> shots_;  // by mission
  std::mutex plan_mutex_;

  // of look(), its thread's own
  std::string seen_mission_;
  std::uint64_t seen_revision_ = 0;
};

}  // namespace overfly::link
