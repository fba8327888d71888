#include "tiling/pyramid/map_writer.h"

namespace overfly::tiling {
namespace {

constexpr std::size_t kTilesPerCommit = 32;

}  // namespace

Result<void> MapWriter::add(const Tile& tile) {
  auto encoded = encodeTile(tile, options_);
  if (!encoded) return tl::unexpected(encoded.error());
  batch_.tiles.push_back(std::move(*encoded));
  return batch_.tiles.size() >= kTilesPerCommit ? flush() : Result<void>{};
}

Result<void> MapWriter::flush() {
  if (batch_.tiles.empty() && batch_.frames.empty()) return {};
  auto revision = store_.commit(batch_);
  if (!revision) return tl::unexpected(revision.error());
  batch_ = {};
  return {};
}

}  // namespace overfly::tiling
