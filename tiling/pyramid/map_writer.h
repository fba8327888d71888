#pragma once
#include <optional>

#include "config/error.h"
#include "tiling/store/map_store.h"
#include "tiling/store/tile_codec.h"
#include "tiling/tile.h"

namespace overfly::tiling {

// Codes tiles and collects them into transactions of some dozens, on the calling thread. What was not flushed
// is not written. Thread rule: the store's.
class MapWriter {
 public:
  // The store outlives it.
  explicit MapWriter(MapStore& store) : store_(store), options_(encodeOptions(store.meta())) {}

  // The store's and the coding's errors.
  [[nodiscard]] Result<void> add(const Tile& tile);
  // One picture layer of a tile, from its colour; what else is stored of it stays.
  [[nodiscard]] Result<void> addPicture(const Tile& tile, Layer layer);
  void add(FrameRecord frame) { batch_.frames.push_back(std::move(frame)); }
  [[nodiscard]] Result<void> flush();

 private:
  MapStore& store_;
  [[nodiscard]] Result<void> add(TileWrite&& tile);

  EncodeOptions options_;
  std::optional<MapReader> reader_;
  Batch batch_;
};

}  // namespace overfly::tiling
