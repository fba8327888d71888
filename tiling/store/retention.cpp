#include "tiling/store/retention.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

namespace overfly::tiling {
namespace {

// How many other frames see the middle of each frame's ground, at most kWellCovered.
std::vector<int> coverage(const std::vector<FrameRecord>& frames) {
  std::vector<int> covered(frames.size(), 0);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (!frames[i].box) continue;
    const double x = (frames[i].box->west + frames[i].box->east) / 2;
    const double y = (frames[i].box->north + frames[i].box->south) / 2;
    for (std::size_t j = 0; j < frames.size() && covered[i] < kWellCovered; ++j) {
      const std::optional<PlaneBox>& box = frames[j].box;
      if (j != i && box && frames[j].state == FrameState::Mapped && box->west <= x && x <= box->east &&
          box->north <= y && y <= box->south)
        ++covered[i];
    }
  }
  return covered;
}

// The State layers of the tiles that changed longest ago, until `wanted` bytes are found.
Result<std::uint64_t> dropStates(const MapReader& reader, std::uint64_t wanted, Batch& batch) {
  std::uint64_t freed = 0;
  ChangeFilter filter;
  filter.layers = only(Layer::State);
  std::vector<Change> states;
  for (ChangeCursor cursor; !cursor.done;) {
    const auto page = reader.changes(cursor, filter, 4096);
    if (!page) return tl::unexpected(page.error());
    std::copy_if(page->changes.begin(), page->changes.end(), std::back_inserter(states),
                 [](const Change& change) { return !change.erased; });
    cursor = page->next;
  }
  std::sort(states.begin(), states.end(),
            [](const Change& a, const Change& b) { return a.revision < b.revision; });
  for (const Change& change : states) {
    if (freed >= wanted) break;
    const Result<TileInfo> info = reader.info(change.key);
    if (!info) continue;  // erased meanwhile, or damaged: not ours to touch
    TileWrite write;
    write.key = change.key;
    write.layers = {{Layer::State, Codec::Erased, {}, {}}};
    write.frame_set = info->frame_set;
    write.gsd_m = info->gsd_m;
    write.provisional = info->provisional;
    batch.tiles.push_back(std::move(write));
    freed += change.bytes;
  }
  return freed;
}

}  // namespace

Result<RetentionPlan> planRetention(const MapReader& reader, const std::filesystem::path& folder,
                                    std::uint64_t budget_bytes) {
  const Result<StoreStatistics> statistics = reader.statistics();
  if (!statistics) return tl::unexpected(statistics.error());
  RetentionPlan plan;
  const std::uint64_t in_use =
      statistics->file_bytes - std::min(statistics->free_bytes, statistics->file_bytes);
  plan.used_bytes = in_use + statistics->log_bytes + statistics->frame_bytes;
  if (plan.used_bytes <= budget_bytes) return plan;
  const std::uint64_t wanted = plan.used_bytes - budget_bytes;

  Result<std::vector<FrameRecord>> frames = reader.frames();
  if (!frames) return tl::unexpected(frames.error());
  const std::vector<int> covered = coverage(*frames);
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < frames->size(); ++i) {
    const FrameRecord& frame = (*frames)[i];
    if (frame.bytes > 0 && (frame.state == FrameState::Refused || frame.state == FrameState::Mapped))
      order.push_back(i);
  }
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const auto rank = [&](std::size_t i) {
      const FrameRecord& frame = (*frames)[i];
      return std::tuple(frame.state != FrameState::Refused, -covered[i], frame.time_ns, frame.id);
    };
    return rank(a) < rank(b);
  });
  for (const std::size_t i : order) {
    if (plan.freed_bytes >= wanted) break;
    FrameRecord& frame = (*frames)[i];
    const std::filesystem::path path = frame.path;
    plan.files.push_back(path.is_absolute() ? path : folder / path);
    plan.freed_bytes += frame.bytes;
    frame.state = FrameState::Dropped;
    plan.batch.frames.push_back(std::move(frame));
  }
  if (plan.freed_bytes < wanted) {
    const Result<std::uint64_t> states = dropStates(reader, wanted - plan.freed_bytes, plan.batch);
    if (!states) return tl::unexpected(states.error());
    plan.freed_bytes += *states;
  }
  plan.still_over_bytes = wanted - std::min(wanted, plan.freed_bytes);
  return plan;
}

Result<void> removeFiles(const RetentionPlan& plan) {
  for (const std::filesystem::path& path : plan.files) {
    std::error_code problem;
    std::filesystem::remove(path, problem);
    if (problem) return fail(ErrorCode::Io, fmt::format("{}: {}", path.string(), problem.message()));
  }
  return {};
}

}  // namespace overfly::tiling
