#include "tiling/pyramid/map_writer.h"

namespace overfly::tiling {
namespace {

constexpr std::size_t kTilesPerCommit = 32;

}  // namespace

Result<void> MapWriter::add(const Tile& tile) {
  auto encoded = encodeTile(tile, options_);
  if (!encoded) return tl::unexpected(encoded.error());
  return add(std::move(*encoded));
}

Result<void> MapWriter::addPicture(const Tile& tile, Layer layer) {
  auto encoded = encodePicture(tile.color, tile.size, layer, options_.color);
  if (!encoded) return tl::unexpected(encoded.error());
  if (!reader_) {
    auto reader = store_.reader();
    if (!reader) return tl::unexpected(reader.error());
    reader_.emplace(std::move(*reader));
  }
  TileWrite write;
  write.key = tile.key;
  const auto known = reader_->info(tile.key);
  if (!known && known.error().code != ErrorCode::NotFound) return tl::unexpected(known.error());
  if (known) {
    write.frame_set = known->frame_set;
    write.gsd_m = known->gsd_m;
    write.provisional = known->provisional;
  }
  write.layers.push_back(std::move(*encoded));
  return add(std::move(write));
}

Result<void> MapWriter::add(TileWrite&& tile) {
  batch_.tiles.push_back(std::move(tile));
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
