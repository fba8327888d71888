#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/pull/mirror.h"
#include "daemon/pull/transfer.h"

namespace overfly::pull {

struct PullOptions {
  std::string url;               // of the drone's link, with /t/TOKEN or /m/MISSION if need be
  std::filesystem::path target;  // a folder, or a file that ends in .mbtiles
  std::string token;
  std::string ca_file;
  tiling::LayerSet layers = tiling::kAllLayers;
  int connections = 4;      // to the drone, events included
  bool once = false;        // end when everything that the drone has is here
  double give_up_s = 0;     // end when the drone has not answered for so long; 0: never
  double stall_time_s = 6;  // a connection that brings nothing for so long is given up
};

struct PullStatus {
  std::string mission, map;  // empty: no contact yet
  std::filesystem::path mirror;
  bool connected = false;      // the last try succeeded
  bool complete = false;       // everything that is known of is here
  std::uint64_t revision = 0;  // the drone's, as far as it is known here
  std::uint64_t layers = 0;    // written to the mirror by this run
  std::uint64_t bytes = 0;     // received by this run, lists included
  std::size_t wanted = 0;      // layers
  std::uint64_t wanted_bytes = 0;
  double lag_s = 0;  // how long the oldest change that is not here has been known of
  double bytes_per_s = 0;
  std::uint64_t reconnects = 0;     // transfers that broke off
  std::uint64_t resumed_bytes = 0;  // of broken-off tiles, kept and not sent again
  std::string problem;              // what stands in the way now; empty: nothing
};

// The ground side of the link: keeps a mirror of a drone's map fresh. What was received is written tile by
// tile in transactions together with the place in the list of changes, so that it goes on after anything.
//
// Thread rules: run() once, on any thread; stop(), status() and lookAt() from any other meanwhile.
class Puller {
 public:
  explicit Puller(PullOptions options);
  ~Puller();
  Puller(const Puller&) = delete;
  Puller& operator=(const Puller&) = delete;

  // Until stop(), or, with `once`, until everything is here. `tick` is called about five times a second.
  // BadSettings: a URL, token or target that the user must change. BadInput: the target holds something else.
  // Unavailable: give_up_s passed.
  [[nodiscard]] Result<void> run(const std::function<void(const PullStatus&)>& tick);
  void stop();
  [[nodiscard]] PullStatus status() const;
  // Somebody on the ground looks at this tile of the current mirror: it comes before others.
  void lookAt(const geo::TileKey& key);
  // Called after each commit that changed the mirror, on run()'s thread. Set before run().
  void onCommit(std::function<void()> listener);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::pull
