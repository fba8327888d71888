#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <filesystem>

#include "daemon/overflyd/boot_clock.h"
#include "daemon/overflyd/log.h"
#include "daemon/overflyd/pipeline.h"
#include "tiling/store/retention.h"
#include "tiling/store/tile_codec.h"

// The encoding thread: from tiles to committed batches, within the disk's limits.
namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr auto kDiskLook = 1s;     // between two looks at the free space
constexpr auto kBudgetLook = 10s;  // between two looks at the mission's share of the disk

}  // namespace

void Pipeline::encode(const std::stop_token& stop) {
  std::optional<Clock::time_point> until;
  for (;;) {
    beat(Stage::Encoding);
    measureCommits();
    std::optional<Encoding> work;
    {
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, stop, committing_.empty() ? 500ms : 50ms, [&] { return !encoding_.empty(); });
      // What cannot be encoded in time is made again when the mission is taken up.
      if (stop.stop_requested() && !until) until = Clock::now() + 700ms;
      if (stop.stop_requested() && (encoding_.empty() || Clock::now() > *until)) break;
      if (!encoding_.empty()) {
        work = std::move(encoding_.front());
        encoding_.pop_front();
        writing_ = true;
        wake_.notify_all();
      }
    }
    if (work) {
      begin(Stage::Encoding);
      write(std::move(*work), stop);
    }
    if (has_writer_ && !stop.stop_requested()) keepBudget();
    // Nothing is left only when the disk has it.
    const bool flushed = committing_.empty();
    const std::scoped_lock lock(mutex_);
    writing_ = !flushed;
  }
  if (has_writer_) (void)writer_->flush(1000ms);
  measureCommits();
}

// Why nothing can be written now; empty: it can.
std::string Pipeline::diskProblem() {
  const auto now = Clock::now();
  if (now - disk_looked_at_ < kDiskLook) return disk_problem_;
  disk_looked_at_ = now;
  int needed_mb = 0;
  {
    const std::scoped_lock lock(mutex_);
    needed_mb = settings_.store.min_free_mb;
  }
  std::error_code code;
  const auto space = std::filesystem::space(folder_, code);
  const std::uintmax_t left_mb = code ? UINTMAX_MAX : space.available >> 20;
  disk_problem_ =
      left_mb >= static_cast<std::uintmax_t>(needed_mb)
          ? ""
          : fmt::format("the disk has {} MB left, less than store.min_free_mb ({}): the map waits", left_mb,
                        needed_mb);
  return disk_problem_;
}

void Pipeline::write(Encoding work, const std::stop_token& stop) {
  const std::int64_t start_ns = now_ns();
  tiling::EncodeOptions options = tiling::encodeOptions(writer_->meta());
  {
    const std::scoped_lock lock(mutex_);
    options.color.quality = settings_.store.color_quality;
    if (settings_.store.color_codec == config::ColorCodec::Webp)
      options.color.format = tiling::ColorFormat::Webp;
  }
  tiling::Batch batch;
  batch.frames = std::move(work.frames);
  batch.values = std::move(work.values);
  for (const tiling::Tile& tile : work.tiles) {
    auto encoded = tiling::encodeTile(tile, options);
    if (!encoded) {
      spdlog::error("tile {}/{}/{}: {}", tile.key.zoom, tile.key.x, tile.key.y, encoded.error().message);
      continue;
    }
    batch.tiles.push_back(std::move(*encoded));
  }
  {
    const std::scoped_lock lock(mutex_);
    status_.encode_s += static_cast<double>(now_ns() - start_ns) / 1e9;
  }
  for (;;) {
    beat(Stage::Encoding);  // a full disk is not cured by a restart
    std::string problem = diskProblem();
    bool submitted = false;
    if (problem.empty()) {
      if (auto done = writer_->submit(std::move(batch))) {
        committing_.push_back({std::move(*done), std::move(work.sights)});
        submitted = true;
      }
      const auto store = writer_->status();
      if (store.degraded) problem = store.reason;
    }
    {
      const std::scoped_lock lock(mutex_);
      status_.store_problem = problem;
    }
    if (submitted || stop.stop_requested()) return;
    std::this_thread::sleep_for(100ms);
  }
}

void Pipeline::measureCommits() {
  const std::int64_t now = now_ns();
  while (!committing_.empty() && committing_.front().done.wait_for(0s) == std::future_status::ready) {
    Committing batch = std::move(committing_.front());
    committing_.pop_front();
    if (const auto revision = batch.done.get(); !revision) {
      warnOnce("commit", fmt::format("a batch of tiles was not written: {}", revision.error().message));
      continue;
    }
    const std::scoped_lock lock(mutex_);
    for (const Latency::Sight& sight : batch.sights)
      (sight.swept ? swept_ : provisional_).add(static_cast<double>(now - sight.shutter_ns) / 1e9);
  }
}

// Gives up images of frames when the mission takes more of the disk than it may.
void Pipeline::keepBudget() {
  const auto now = Clock::now();
  if (now - budget_looked_at_ < kBudgetLook) return;
  budget_looked_at_ = now;
  std::uint64_t budget = 0;
  {
    const std::scoped_lock lock(mutex_);
    budget = static_cast<std::uint64_t>(settings_.store.disk_budget_mb) << 20;
  }
  if (budget == 0) return;
  auto reader = writer_->reader();
  if (!reader) return;
  auto plan = tiling::planRetention(*reader, folder_, budget);
  if (!plan) {
    warnOnce("budget", fmt::format("store.disk_budget_mb: {}", plan.error().message));
    return;
  }
  if (plan->still_over_bytes > 0)
    warnOnce("over budget",
             fmt::format("the mission takes {} MB more than store.disk_budget_mb, and nothing is "
                         "left that may be given up",
                         plan->still_over_bytes >> 20));
  if (plan->files.empty() && plan->batch.frames.empty() && plan->batch.tiles.empty()) return;
  if (auto removed = tiling::removeFiles(*plan); !removed) {
    warnOnce("budget", removed.error().message);
    return;
  }
  spdlog::info("{} images given up to keep store.disk_budget_mb", plan->files.size());
  if (auto done = writer_->submit(std::move(plan->batch))) committing_.push_back({std::move(*done), {}});
}

}  // namespace overfly::daemon
