#pragma once
#include <cstdint>
#include <filesystem>
#include <vector>

#include "config/error.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {

// What to give up when a map and its frames pass their share of the disk. The rule: first the image files of
// refused frames, then those of mapped frames whose ground other frames cover best, the oldest first among
// equals; then the tiles' State layers, of the tiles that changed longest ago. Frames that wait to be mapped
// stay, and so does every finished layer: what is over the budget after that is reported, not deleted.
struct RetentionPlan {
  std::vector<std::filesystem::path> files;  // remove these, then commit the batch
  Batch batch;                               // frames become Dropped, State layers are erased
  std::uint64_t used_bytes = 0;              // before
  std::uint64_t freed_bytes = 0;
  std::uint64_t still_over_bytes = 0;  // 0: the budget holds again
};

// `folder` is where relative frame paths begin. Reads frames and statistics; a map within its budget gets
// an empty plan and costs little. Frames at least kWellCovered times covered count as equals.
inline constexpr int kWellCovered = 8;
[[nodiscard]] Result<RetentionPlan> planRetention(const MapReader& reader,
                                                  const std::filesystem::path& folder,
                                                  std::uint64_t budget_bytes);

// Removes the files of a plan. Those that are gone already are fine; an image that cannot be removed is Io.
[[nodiscard]] Result<void> removeFiles(const RetentionPlan& plan);

}  // namespace overfly::tiling
