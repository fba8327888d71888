#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "capture/frame.h"
#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "tiling/store/frame_record.h"
#include "tiling/store/layer.h"

namespace overfly::tiling {

// A map on disk: tiles of every level, the frames that they were made from, the work that is still to do.
// docs/tile-store.md describes the file. What holds:
//   1. A commit is whole or absent, also after kill -9 or a power cut; an acknowledged revision is never
//   lost.
//   2. Every tile that a commit changes gets the map's next revision number; a revision is never reused.
//   3. Bytes that do not match their checksum are reported as Corrupt and never handed out.
//   4. Readers never wait for the writer, and no read holds a transaction beyond its own call.
// Thread rule: a MapStore belongs to one thread (StoreWriter gives it one). Each reading thread has a
// MapReader of its own.

// What a map is, fixed when it is made (see MapStore::amend).
struct MapMeta {
  std::string id;                       // 32 hexadecimal digits, drawn by create(): names this map for ever
  std::string name;                     // for people
  std::string lattice = "webmercator";  // TileLattice::text()
  capture::VerticalDatum datum = capture::VerticalDatum::Unknown;  // of all heights in the map
  std::string geoid;                // the model's name when datum is Geoid, e.g. "egm96"
  int tile_size = 256;              // texels along a side, 2^n
  int base_zoom = 0;                // the zoom of level 0 (z0)
  double elevation_step_m = 0.01;   // quantum of the Elevation and ElevationMax layers
  std::int64_t created_utc_ns = 0;  // Unix epoch
  std::string extra = "{}";         // JSON, for whoever makes the map
};

struct StoreOptions {
  std::string vfs;                     // SQLite VFS by name; empty: the system's (tests inject faults)
  std::size_t cache_bytes = 4u << 20;  // SQLite's page cache, per connection
  std::uint64_t wal_checkpoint_bytes = 8u << 20;  // the log is moved into the file beyond this size ...
  std::uint64_t wal_limit_bytes = 64u
                                  << 20;  // ... and the writer waits for readers to let it beyond this one
};

// One tile's new layers. Layers that are not named keep what they have. An erased tile keeps a trace of its
// revision, so that mirrors learn of it.
struct TileWrite {
  geo::TileKey key;
  bool top = false;    // the special top tile: key.zoom is its children's zoom - 1, key.x and key.y are the
                       // index of its north-west child; writing it replaces an earlier top tile
  bool erase = false;  // all layers
  std::vector<EncodedLayer> layers;
  std::vector<std::uint64_t> frame_set;  // ids, ascending; empty for parents
  float gsd_m = 0;                       // median of the source frames; 0: unknown
  bool provisional = false;              // plain projection, the true orthophoto is still to come
};

// A piece of work that has to survive a restart. `kind` is the scheduler's own.
struct QueueEntry {
  geo::TileKey key;
  int kind = 0;
  double priority = 0;
  std::string detail;
};

// Everything here becomes visible and durable together.
struct Batch {
  std::vector<TileWrite> tiles;
  std::vector<FrameRecord> frames;                          // inserted, or replaced by id
  std::vector<QueueEntry> enqueue;                          // inserted, or replaced by key and kind
  std::vector<std::pair<geo::TileKey, int>> dequeue;        // key and kind
  std::vector<std::pair<std::string, std::string>> values;  // key-value pairs; an empty value removes
};

struct StoredLayer {
  EncodedLayer encoded;
  std::uint64_t revision = 0;
};

struct TileInfo {
  geo::TileKey key;
  std::uint64_t revision = 0;  // of the last change of any layer
  std::vector<std::uint64_t> frame_set;
  float gsd_m = 0;
  bool provisional = false;
  LayerSet layers = 0;
};

struct WholeTile {
  TileInfo info;
  std::vector<StoredLayer> layers;  // those asked for that there are, by number
};

// --- changes ---------------------------------------------------------------------------------------------

struct ChangeFilter {
  std::optional<PlaneBox> box = std::nullopt;
  LayerSet layers = kAllLayers;
  int min_zoom = 0;
  int max_zoom = 63;
};

// A place in the list of what changed in (since, until], coarse levels first and by revision within a level.
// A layer that changes again while the list is read leaves it and comes in the next one (since = until): so
// no (tile, layer, revision) is listed twice, and none is left out.
struct ChangeCursor {
  std::uint64_t since = 0;
  std::uint64_t until = 0;  // 0: the revision at the first call
  int zoom = 0;             // everything up to (zoom, revision) is done
  std::uint64_t revision = 0;
  bool done = false;                       // nothing is left up to `until`
  [[nodiscard]] std::string text() const;  // "since.until.zoom.revision", for URLs
  [[nodiscard]] static Result<ChangeCursor> parse(const std::string& text);  // also a bare "since"
  [[nodiscard]] static ChangeCursor after(std::uint64_t since) { return {.since = since}; }
  friend bool operator==(const ChangeCursor&, const ChangeCursor&) = default;
};

struct Change {
  geo::TileKey key;
  Layer layer = Layer::Color;
  std::uint64_t revision = 0;
  std::uint32_t bytes = 0;  // encoded; 0 when erased
  bool erased = false;
};

struct ChangePage {
  std::vector<Change> changes;
  ChangeCursor next;  // go on from here; next.done when the list has ended
};

// --- statistics ------------------------------------------------------------------------------------------

struct LevelStatistics {
  Layer layer = Layer::Color;
  int zoom = 0;
  std::int64_t min_x = 0, min_y = 0, max_x = 0, max_y = 0;  // inclusive
  std::uint64_t tiles = 0;
  std::uint64_t bytes = 0;
};

struct StoreStatistics {
  std::uint64_t revision = 0;
  std::vector<LevelStatistics> levels;          // by layer, then zoom
  std::uint64_t tiles = 0;                      // that have at least one layer
  std::uint64_t file_bytes = 0, log_bytes = 0;  // main file and write-ahead log on disk
  std::uint64_t free_bytes = 0;                 // inside the file, reused first
  std::uint64_t frames[4] = {};                 // by FrameState
  std::uint64_t frame_bytes = 0;                // image files not dropped
  std::uint64_t queued = 0;
};

// --- reading ---------------------------------------------------------------------------------------------

// A read-only connection. One thread at a time; make one per thread. Every call is one short transaction.
// Errors: NotFound (never stored, or erased), Corrupt (damaged on disk: re-make it), Io.
class MapReader {
 public:
  // NotFound: no such file. BadInput: not a map, or made by a newer overfly. Corrupt: torn.
  [[nodiscard]] static Result<MapReader> open(const std::filesystem::path& path,
                                              const StoreOptions& options = {});
  MapReader(MapReader&&) noexcept;
  MapReader& operator=(MapReader&&) noexcept;
  ~MapReader();

  [[nodiscard]] Result<MapMeta> meta() const;
  [[nodiscard]] int tileSize() const;  // as it was when the reader was opened
  [[nodiscard]] Result<std::uint64_t> revision() const;
  [[nodiscard]] Result<StoredLayer> read(const geo::TileKey& key, Layer layer) const;
  // All of them from one moment.
  [[nodiscard]] Result<WholeTile> readWhole(const geo::TileKey& key, LayerSet layers) const;
  // The layer's revision without its bytes (for a conditional request).
  [[nodiscard]] Result<std::uint64_t> layerRevision(const geo::TileKey& key, Layer layer) const;
  [[nodiscard]] Result<TileInfo> info(const geo::TileKey& key) const;
  // The special top tile; its key says where its children lie (see TileWrite::top).
  [[nodiscard]] Result<WholeTile> readTop(LayerSet layers) const;

  // At most `limit` layers and, beyond the first tile, `max_bytes` of them; all wanted layers of a tile come
  // together, so `limit` may be passed by a tile's worth.
  [[nodiscard]] Result<ChangePage> changes(const ChangeCursor& from, const ChangeFilter& filter,
                                           std::size_t limit, std::uint64_t max_bytes = UINT64_MAX) const;

  // Keys of the stored tiles of one zoom that have `layer`, in (y, x) order after `after`; at most `limit`.
  [[nodiscard]] Result<std::vector<geo::TileKey>> keys(int zoom, Layer layer,
                                                       const std::optional<geo::TileKey>& after,
                                                       std::size_t limit) const;

  // Where a layer has tiles, in plane coordinates, from levels 0 and finer (else from the finest there is).
  [[nodiscard]] Result<PlaneBox> bounds(Layer layer) const;
  [[nodiscard]] Result<std::pair<int, int>> zoomRange(Layer layer) const;
  [[nodiscard]] Result<StoreStatistics> statistics() const;

  [[nodiscard]] Result<FrameRecord> frame(std::uint64_t id) const;
  // In the order of ids, after `after_id`, at most `limit`.
  [[nodiscard]] Result<std::vector<FrameRecord>> frames(std::optional<std::uint64_t> after_id = {},
                                                        std::size_t limit = SIZE_MAX) const;
  [[nodiscard]] Result<std::vector<QueueEntry>> queue() const;
  [[nodiscard]] Result<std::string> value(const std::string& key) const;

  // Reads every tile and compares its checksum; the damaged ones. `progress` gets done and total tiles
  // and ends the walk by returning false.
  [[nodiscard]] Result<std::vector<std::pair<geo::TileKey, Layer>>> verify(
      const std::function<bool(std::uint64_t, std::uint64_t)>& progress = {}) const;

 private:
  struct Impl;
  explicit MapReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// --- writing ---------------------------------------------------------------------------------------------

class MapStore {
 public:
  // Makes a new map. BadInput when the file exists and is not empty. A killed create() leaves
  // nothing at `path`, at most a ".new" file that the next one removes.
  [[nodiscard]] static Result<MapStore> create(const std::filesystem::path& path, const MapMeta& meta,
                                               const StoreOptions& options = {});
  // Opens for writing and migrates an older schema forward. Errors as MapReader::open.
  [[nodiscard]] static Result<MapStore> open(const std::filesystem::path& path,
                                             const StoreOptions& options = {});
  MapStore(MapStore&&) noexcept;
  MapStore& operator=(MapStore&&) noexcept;
  ~MapStore();

  [[nodiscard]] const std::filesystem::path& path() const;
  [[nodiscard]] const MapMeta& meta() const;
  // Changes what was not known when the map was made (zoom of level 0, datum, name). BadInput once a tile
  // is stored and the change would alter its meaning; name and extra may always change.
  [[nodiscard]] Result<void> amend(const MapMeta& meta);

  // Writes the batch and waits until the disk has it. Returns the map's revision afterwards. Io: nothing of
  // the batch was written, and the same batch may be committed again when the disk has recovered.
  [[nodiscard]] Result<std::uint64_t> commit(const Batch& batch);

  // Called after each commit that changed a tile, on the committing thread, with the new revision and the
  // tiles that changed. Returns a handle for removeListener. Thread-safe.
  using Listener = std::function<void(std::uint64_t revision, const std::vector<geo::TileKey>& tiles)>;
  int addListener(Listener listener);
  void removeListener(int handle);

  // A reader of the same file with the same options; may be called from any thread.
  [[nodiscard]] Result<MapReader> reader() const;

  // Moves the log into the file; returns the log's size afterwards. commit() does it by itself.
  [[nodiscard]] Result<std::uint64_t> checkpoint();

 private:
  struct Impl;
  explicit MapStore(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::tiling
