#pragma once
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "capture/frame_source.h"
#include "capture/live/live_source.h"
#include "config/settings.h"
#include "daemon/overflyd/recorded_frames.h"
#include "tiling/clipmap/scheduler.h"
#include "tiling/mapping/mapper.h"
#include "tiling/store/store_writer.h"

namespace overfly::daemon {

// How far the pipeline is. Copied out under a lock; times are seconds.
struct PipelineStatus {
  std::string source;
  bool source_open = false, source_ended = false;
  std::uint64_t seen = 0;                        // frames from the source
  std::uint64_t mapped = 0;                      // in the index
  std::map<std::string, std::uint64_t> refused;  // by reason
  std::uint64_t late_poses = 0;                  // came after their frames had been refused for lack of them
  std::uint64_t waiting_frames = 0;              // seen, not yet in the index
  std::uint64_t waiting_cells = 0;
  std::uint64_t tiles = 0;   // written, updates counted
  double lag_s = 0;          // age of the oldest frame that is not in the map's tiles yet
  double first_sight_s = 0;  // of the last frame: from its arrival to its provisional tiles
  bool settled = false;      // the map's place is known, its file exists
  bool idle = false;         // nothing to do
  bool failed = false;       // a stage has given up: `error`
  std::string error;
  std::string store_problem;  // the disk refuses; kept in memory meanwhile
  tiling::MapperStatistics mapper;
};

// One mission, from the source to the map's file (docs/threads.md): a capture thread, a mapping thread that
// owns the GL context, an encoding thread, the store's writing thread. Queues are bounded: what does not fit
// into memory stays recorded on disk and is read again when its turn comes, so that capture never waits
// and nothing is lost.
class Pipeline {
 public:
  // `folder`: the mission's; taken up again where an earlier run left it.
  Pipeline(const config::Settings& settings, std::unique_ptr<capture::FrameSource> source,
           std::filesystem::path folder);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  [[nodiscard]] Result<void> start();
  // Ends all threads within 2 s, with everything committed that was made.
  void stop();

  [[nodiscard]] PipelineStatus status() const;
  // The source, when it is a live one; else null. Lives as long as the pipeline.
  [[nodiscard]] capture::LiveSource* live() const { return live_; }
  [[nodiscard]] std::filesystem::path mapFile() const { return folder_ / "map.overfly"; }
  // Somebody looks at this tile of the map.
  void interest(const geo::TileKey& key);
  // Called on the writer's thread after each commit.
  void onCommit(std::function<void()> listener) { on_commit_ = std::move(listener); }
  // Counts up whenever a stage gets on; for the watchdog.
  [[nodiscard]] std::uint64_t progress() const { return progress_; }

 private:
  struct Waiting {
    std::uint64_t id;
    capture::FramePtr frame;  // null: read it again from the recording
    std::int64_t arrived_ns;
  };
  struct Encoding {
    std::vector<tiling::Tile> tiles;
    std::vector<tiling::FrameRecord> frames;
  };

  void capture(const std::stop_token& stop);
  void map(const std::stop_token& stop);
  void encode(const std::stop_token& stop);

  // On the mapping thread.
  [[nodiscard]] Result<void> settle(tiling::Mapper& mapper);
  [[nodiscard]] Result<void> takeFrame(tiling::Mapper& mapper, const Waiting& waiting);
  [[nodiscard]] Result<void> work(tiling::Mapper& mapper, const tiling::TileJob& job);
  [[nodiscard]] Result<void> makeParentOf(const geo::TileKey& key);
  void publish(std::vector<tiling::Tile> tiles);
  void refuse(std::uint64_t id, const std::string& reason);
  void takeLatePoses();
  void giveUp(const Error& error);

  config::Settings settings_;
  std::unique_ptr<capture::FrameSource> source_;
  capture::LiveSource* live_;  // source_, or null
  std::filesystem::path folder_;
  std::unique_ptr<RecordedFrames> recorded_;
  capture::FlightInfo flight_info_;
  std::function<void()> on_commit_;

  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  std::deque<Waiting> frames_;
  std::deque<geo::TileKey> interests_;
  std::deque<Encoding> encoding_;
  PipelineStatus status_;
  std::atomic<std::uint64_t> progress_{0};

  // Of the mapping thread, once settled.
  std::unique_ptr<tiling::Scheduler> scheduler_;
  std::map<geo::TileKey, std::int64_t> cell_since_ns_;  // arrival of the oldest frame that a cell waits for
  std::set<geo::TileKey> seen_cells_;
  std::map<geo::TileKey, std::shared_ptr<const tiling::Tile>> recent_;  // tiles for their parents
  std::deque<geo::TileKey> recent_order_;
  std::vector<Waiting> unsettled_;
  std::unique_ptr<tiling::StoreWriter> writer_;
  std::optional<tiling::MapReader> reader_;

  std::vector<std::jthread> threads_;
};

}  // namespace overfly::daemon
