#pragma once
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
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
#include "daemon/governor/governor.h"
#include "daemon/governor/throttling.h"
#include "daemon/overflyd/gpu_fault.h"
#include "daemon/overflyd/latency.h"
#include "daemon/overflyd/recorded_frames.h"
#include "daemon/overflyd/stage.h"
#include "render/gl/gl_thread.h"
#include "tiling/adjust/live_adjust.h"
#include "tiling/clipmap/scheduler.h"
#include "tiling/mapping/mapper.h"
#include "tiling/store/store_writer.h"

namespace overfly::daemon {

// Where on the front of accuracy against time the map is being made.
struct QualityStatus {
  std::string mode;
  std::string point;             // the present one, in words
  std::size_t index = 0;         // 1: the fastest
  std::size_t points = 0;        // on the front; the last one is what the settings say
  double nmad_gsd = 0;           // that the table states for it
  double complete = 0;           // likewise
  double cell_s = 0;             // that a cell takes there on this device, other work included
  double backlog_s = 0;          // until everything that waits is swept
  std::uint64_t to_improve = 0;  // cells made at a faster point than the last
  std::uint64_t changes = 0;     // of the point, since the start
  double headroom = 1;           // below 1: throttled by heat
  std::string throttled;         // who says so
  double aim_s = 0;              // from a frame to its tiles, that the settings aim at; may be infinite
  std::shared_ptr<const OperatingTable> front;  // null: mapping has not begun
  std::vector<double> front_cell_s;             // cell_s of each of its points
};

// How far the pipeline is. Copied out under a lock; times are seconds.
struct PipelineStatus {
  std::string source;
  bool source_open = false, source_ended = false;
  std::uint64_t seen = 0;                        // frames from the source
  std::uint64_t mapped = 0;                      // in the index
  std::map<std::string, std::uint64_t> refused;  // by reason
  std::uint64_t late_poses = 0;                  // came after their frames had been refused for lack of them
  std::uint64_t waiting_frames = 0;              // seen, not yet in the index
  std::uint64_t waiting_cells = 0;               // whose frames or surroundings have changed
  std::uint64_t cells = 0;                       // that some frame sees
  std::uint64_t tiles = 0;                       // written, updates counted
  double lag_s = 0;  // age of the oldest work that is due: a frame not in the index, a cell worth a sweep
  Latency::Summary provisional_s, swept_s;  // from the shutter to a tile on the link, see latency.h
  bool settled = false;                     // the map's place is known, its file exists
  bool idle = false;                        // nothing to do
  bool failed = false;                      // a stage has given up: `error`
  bool bad_settings = false;                // ... because of settings that somebody has to change
  std::string error;
  std::string store_problem;       // the disk refuses; kept in memory meanwhile
  std::uint64_t gpu_failures = 0;  // lost, or out of memory, while mapping: the work was done again
  std::vector<std::string> stuck;  // stages that have been silent for longer than kStageSilence
  tiling::MapperStatistics mapper;
  QualityStatus quality;
  tiling::adjust::LiveAdjuster::Status adjust;       // held_back: frames without a usable pose, by reason
  double adjust_median_s = 0, adjust_p95_s = 0;      // wall time of the last frames' adjustment
  double landing_s = 0;                              // of the adjustment after the last frame
  double record_s = 0, parents_s = 0, encode_s = 0;  // time spent
  double gsd_m = 0, area_m2 = 0;                     // of the map: texel of level 0; cells that are not empty
};

// One mission, from the source to the map's file (docs/threads.md): a capture thread, an adjusting
// thread for frames whose poses are the device's own, a mapping thread that
// has its GPU work done by the GL thread, an encoding thread, the store's writing thread. Queues are bounded:
// what does not fit into memory stays recorded on disk and is read again when its turn comes, so that capture
// never waits and nothing is lost.
//
// Thread rule: start() and stop() from one thread, all else from any.
class Pipeline {
 public:
  // `folder`: the mission's; taken up again where an earlier run left it. The GL thread is shared with the
  // preview and outlives the pipeline.
  Pipeline(const config::Settings& settings, std::unique_ptr<capture::FrameSource> source,
           std::filesystem::path folder, gl::GlThread& gl);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  // Called on the writer's thread after each commit; before start().
  void onCommit(std::function<void()> listener) { on_commit_ = std::move(listener); }
  // For tests: what is done to the stages (stage.h); before start().
  void setStageHook(StageHook hook) { hook_ = std::move(hook); }
  // ... and to the GPU (gpu_fault.h); before start().
  void setGpuHook(GpuHook hook) { gpu_hook_ = std::move(hook); }
  [[nodiscard]] Result<void> start();
  // No more frames are taken; what was recorded is mapped to its end, with what the GPU has left.
  void endSource();
  // Ends all threads within 2 s, with everything committed that was made; a tile that is under way is put
  // aside, and made when the mission is taken up again.
  void stop();
  // Settings that may change while running: cells swept, tiles encoded and frames taken from now on.
  void reload(const config::Settings& settings);

  [[nodiscard]] PipelineStatus status() const;
  // The source, when it is a live one; else null. Lives as long as the pipeline.
  [[nodiscard]] capture::LiveSource* live() const { return live_; }
  [[nodiscard]] std::filesystem::path mapFile() const { return folder_ / "map.overfly"; }
  // Somebody looks at this tile of the map.
  void interest(const geo::TileKey& key);

 private:
  struct Waiting {
    std::uint64_t id;
    capture::FramePtr frame;  // null: read it again from the recording
    std::int64_t arrived_ns;
    bool again = false;  // has been mapped; its pose was corrected
    capture::TelemetryPtr raw = {};
  };
  struct Encoding {
    std::vector<tiling::Tile> tiles;
    std::vector<tiling::FrameRecord> frames;
    std::vector<Latency::Sight> sights;                       // of frames that these tiles show first
    std::vector<std::pair<std::string, std::string>> values;  // for the map's table of them
  };
  struct Committing {
    std::future<Result<std::uint64_t>> done;
    std::vector<Latency::Sight> sights;
  };

  // A stage's thread: what is thrown ends the pipeline with an error, not the program.
  void runStage(Stage stage, void (Pipeline::*body)(const std::stop_token&), const std::stop_token& stop);
  void beat(Stage stage) { hearts_[static_cast<std::size_t>(stage)].beat(); }
  // Before a piece of work.
  void begin(Stage stage);

  void capture(const std::stop_token& stop);
  void adjust(const std::stop_token& stop);
  void map(const std::stop_token& stop);
  void encode(const std::stop_token& stop);

  // On the capture thread (pipeline.cpp).
  void takeFrames(const std::stop_token& stop);
  [[nodiscard]] bool hasRoom();

  // On the adjusting thread (pipeline_adjust.cpp). With mutex_ held: where a frame goes first.
  [[nodiscard]] std::deque<Waiting>& queueFor(const capture::Frame& frame, const capture::TelemetryPtr& raw);
  void handOn(const std::vector<tiling::adjust::LiveFrame>& ready,
              std::map<std::uint64_t, capture::FramePtr>& in_memory);

  // On the mapping thread (pipeline_map.cpp). `work` as one job on the GL thread, which gives way to previews
  // between the passes of a sweep; waits for it.
  template <typename Work>
  auto onGl(const char* name, Work work) {
    const auto priority = closing_ ? gl::Priority::Background : gl::Priority::Mapping;
    using R = std::invoke_result_t<Work&>;
    return gl_
        .submit(priority, name,
                [&](gl::Context& context) -> R {
                  if (auto ready = readyOnGl(context); !ready) return tl::unexpected(ready.error());
                  R made = work();
                  // What a lost GPU answers is worth nothing, whatever it looks like.
                  const auto healthy = context.check();
                  context_lost_ = context.lost();
                  if (!healthy) return tl::unexpected(healthy.error());
                  return made;
                })
        .get();
  }
  void mapUntil(tiling::Mapper& mapper, const std::stop_token& stop);
  [[nodiscard]] bool takeNext(tiling::Mapper& mapper, Waiting waiting, const std::stop_token& stop);
  [[nodiscard]] Result<void> settle(tiling::Mapper& mapper, const std::stop_token& stop);
  [[nodiscard]] Result<tiling::MapStore> makeMap(tiling::Mapper& mapper, tiling::MapGround& ground,
                                                 const std::stop_token& stop);
  [[nodiscard]] Result<void> takeFrame(tiling::Mapper& mapper, const Waiting& waiting);
  void balance(tiling::Mapper& mapper);
  [[nodiscard]] bool cellsFirst() const;
  // What the job made differs from before.
  [[nodiscard]] Result<bool> work(tiling::Mapper& mapper, const tiling::TileJob& job);
  [[nodiscard]] Result<void> finish(tiling::Mapper& mapper, const geo::TileKey& cell);
  [[nodiscard]] Result<void> makeParentOf(const geo::TileKey& key);
  void publish(std::vector<tiling::Tile> tiles, std::vector<Latency::Sight> sights,
               std::vector<std::pair<std::string, std::string>> values = {});
  void showProgress(const tiling::Mapper& mapper);
  void refuse(std::uint64_t id, const std::string& reason);
  void takeLatePoses();
  void giveUp(const Error& error);
  void stopped(const Error& error, const std::stop_token& stop);

  // On the GL thread and on the mapping thread: a GPU that fails (pipeline_gpu.cpp).
  [[nodiscard]] Result<void> readyOnGl(gl::Context& context);
  [[nodiscard]] bool pauseOnGl(const std::stop_token& stop);
  [[nodiscard]] bool triesAgain(const Error& error, const std::stop_token& stop);
  // The result of `work`, which is tried again when the GPU failed.
  template <typename Work>
  auto persistently(const std::stop_token& stop, Work work) {
    auto made = work();
    while (!made && triesAgain(made.error(), stop)) made = work();
    if (made) gpu_failures_ = 0;
    return made;
  }

  // On the mapping thread: accuracy against time (pipeline_quality.cpp).
  void beginGoverning(const std::string& renderer);
  void reloadQuality(const config::Settings& settings);
  void keepSpeed() const;  // for the next run
  [[nodiscard]] tiling::MapperOptions optionsAt(std::size_t point) const;
  [[nodiscard]] Result<bool> sweepAtPoint(tiling::Mapper& mapper, const geo::TileKey& cell);
  // There is time: the cells made at the fastest points are due again, at the last one. False: there is none.
  [[nodiscard]] bool improveWorst();
  [[nodiscard]] std::string madeAt(const geo::TileKey& cell) const;  // empty: as the settings say
  void alsoSpent(double seconds);                                    // on work beside the sweeps
  void rest(double worked_s);  // what quality.gpu_share leaves to others
  [[nodiscard]] QualityStatus qualityStatus() const;

  // On the encoding thread (pipeline_encode.cpp).
  void write(Encoding work, const std::stop_token& stop);
  void measureCommits();
  [[nodiscard]] std::string diskProblem();
  void keepBudget();

  config::Settings settings_;  // mutex_
  gl::GlThread& gl_;
  std::unique_ptr<capture::FrameSource> source_;
  capture::LiveSource* live_;  // source_, or null
  std::filesystem::path folder_;
  std::unique_ptr<RecordedFrames> recorded_;
  std::function<void()> on_commit_;
  StageHook hook_;
  GpuHook gpu_hook_;
  std::array<Heartbeat, kStageNames.size()> hearts_;
  std::array<std::uint64_t, kStageNames.size()> pieces_{};  // each its stage's own
  std::atomic<bool> closing_{false};                        // takes no more frames

  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  std::deque<Waiting> to_adjust_;  // frames whose poses are the device's own
  std::deque<Waiting> frames_;     // to be mapped
  bool all_handed_on_ = false;     // the source has ended, and nothing comes after what frames_ holds
  std::deque<geo::TileKey> interests_;
  std::deque<Encoding> encoding_;
  bool writing_ = false;   // the encoding thread holds what has left encoding_
  bool reloaded_ = false;  // the mapping thread has not seen the settings yet
  capture::FlightInfo flight_info_;
  PipelineStatus status_;
  Latency provisional_, swept_;

  // Of the mapping thread, once settled.
  std::unique_ptr<tiling::Scheduler> scheduler_;
  tiling::ViewSelectionOptions views_;
  std::set<geo::TileKey> seen_cells_;
  std::map<std::uint64_t, std::int64_t> unswept_;  // shutter times of frames that no swept tile has yet
  std::map<geo::TileKey, std::shared_ptr<const tiling::Tile>> recent_;  // tiles for their parents
  std::deque<geo::TileKey> recent_order_;
  std::vector<Waiting> unsettled_;
  std::string unsettled_reason_;
  std::size_t unbalanced_ = 0;                    // frames since the exposures were equalised
  std::map<geo::TileKey, std::uint32_t> texels_;  // that have colour, by tile of level 0
  double all_texels_ = 0;
  std::optional<tiling::MapReader> reader_;
  tiling::MapperOptions as_set_;
  config::Quality quality_;
  std::string renderer_;
  std::shared_ptr<const OperatingTable> table_;
  std::unique_ptr<Governor> governor_;
  std::map<geo::TileKey, std::size_t> cheap_;  // cells last swept below the last point, and where
  std::set<geo::TileKey> improving_;           // of these, due again
  double owed_s_ = 0;                          // what frames have taken, less what cells have got since
  bool only_improving_ = false;                // the last sweep was one of these
  bool landed_ = false;                        // no frame is to come
  Throttling throttling_;
  std::int64_t heat_looked_at_ns_ = 0;

  // Of the mapping thread, and of the GL thread while the mapping thread waits for it.
  tiling::Mapper* mapper_ = nullptr;
  gl::Context* context_ = nullptr;  // that the last piece of work had
  std::uint64_t generation_ = 0;    // of the context that the mapper was made with
  std::uint64_t passes_ = 0;
  int gpu_failures_ = 0;  // in a row
  bool context_lost_ = false, low_memory_ = false;

  // Of the mapping thread until it says that there is one; then of the encoding thread.
  std::unique_ptr<tiling::StoreWriter> writer_;
  std::atomic<bool> has_writer_{false};
  // Of the encoding thread.
  std::deque<Committing> committing_;
  std::chrono::steady_clock::time_point disk_looked_at_{}, budget_looked_at_{};
  std::string disk_problem_;

  std::vector<std::jthread> threads_;
};

}  // namespace overfly::daemon
