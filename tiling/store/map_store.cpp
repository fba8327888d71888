#include "tiling/store/map_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <map>
#include <mutex>
#include <random>

#include "tiling/store/detail/rows.h"
#include "tiling/store/detail/schema.h"
#include "tiling/store/detail/tile_writer.h"

namespace overfly::tiling {
namespace {

using detail::Database;
using detail::Query;
using detail::Transaction;

constexpr int kBusyMs = 5000;
constexpr int kCheckpointWaitMs = 250;           // for readers to finish their step
constexpr std::uint64_t kFrameHeaderBytes = 24;  // of SQLite's log, per page

std::string drawId() {
  std::random_device device;
  return fmt::format("{:08x}{:08x}{:08x}{:08x}", device(), device(), device(), device());
}

Result<void> checkMeta(const MapMeta& meta) {
  if (meta.tile_size < 16 || meta.tile_size > 4096 || (meta.tile_size & (meta.tile_size - 1)) != 0)
    return fail(ErrorCode::BadInput,
                fmt::format("a tile size of {} is not possible; take 256 or 512", meta.tile_size));
  if (!(meta.elevation_step_m >= 0.001 && meta.elevation_step_m <= 10))
    return fail(
        ErrorCode::BadInput,
        fmt::format("an elevation step of {} m is not possible; take 0.001 to 10", meta.elevation_step_m));
  if (meta.base_zoom < 0 || meta.base_zoom > 30)
    return fail(ErrorCode::BadInput,
                fmt::format("zoom {} for level 0 is not possible; take 0 to 30", meta.base_zoom));
  return {};
}

// Never over a file that came there meanwhile, but over an empty one when that was seen.
Result<void> moveIntoPlace(const std::filesystem::path& fresh, const std::filesystem::path& path,
                           bool replace) {
  if (renameat2(AT_FDCWD, fresh.c_str(), AT_FDCWD, path.c_str(), replace ? 0 : RENAME_NOREPLACE) != 0)
    return fail(ErrorCode::Io, fmt::format("{}: {}", path.string(), std::strerror(errno)));
  const std::filesystem::path folder =
      path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor >= 0) {  // else the folder cannot be read: its entry is written sooner or later
    fsync(descriptor);
    close(descriptor);
  }
  return {};
}

}  // namespace

struct MapStore::Impl {
  std::filesystem::path path;
  StoreOptions options;
  Database database;
  MapMeta meta;
  std::uint64_t page_size = 0;
  std::uint64_t log_bytes = 0;
  bool log_is_stuck = false;  // the last checkpoint failed for another reason than readers

  std::mutex listeners_mutex;
  std::map<int, Listener> listeners;
  int next_listener = 1;

  Impl(std::filesystem::path at, StoreOptions with, Database connection)
      : path(std::move(at)), options(std::move(with)), database(std::move(connection)) {}

  static int onLog(void* self, sqlite3*, const char*, int pages) {
    auto& impl = *static_cast<Impl*>(self);
    impl.log_bytes = static_cast<std::uint64_t>(pages) * (impl.page_size + kFrameHeaderBytes);
    return SQLITE_OK;
  }

  Result<void> tune() {
    const std::string pragmas = fmt::format(
        "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA wal_autocheckpoint = 0; "
        "PRAGMA journal_size_limit = {}; PRAGMA cache_size = -{}; PRAGMA mmap_size = 0; "
        "PRAGMA secure_delete = OFF; PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON;",
        options.wal_limit_bytes, std::max<std::size_t>(options.cache_bytes / 1024, 64));
    if (const Result<void> done = database.execute(pragmas.c_str()); !done) return done;
    const Result<std::int64_t> size = database.integer("PRAGMA page_size");
    if (!size) return tl::unexpected(size.error());
    page_size = static_cast<std::uint64_t>(*size);
    sqlite3_wal_hook(database.handle(), &Impl::onLog, this);
    return {};
  }

  // Passive: moves what no reader needs. Truncate: waits for readers a little and empties the log.
  Result<void> checkpoint(int mode) {
    int log_pages = 0, moved_pages = 0;
    sqlite3_busy_timeout(database.handle(), mode == SQLITE_CHECKPOINT_PASSIVE ? 0 : kCheckpointWaitMs);
    const int code = sqlite3_wal_checkpoint_v2(database.handle(), nullptr, mode, &log_pages, &moved_pages);
    const Error error = detail::sqliteError(database.handle(), code, path.string());
    sqlite3_busy_timeout(database.handle(), kBusyMs);
    log_is_stuck = code != SQLITE_OK && (code & 0xff) != SQLITE_BUSY;
    // When all of it was moved, the next commit begins the log anew.
    if (code == SQLITE_OK)
      log_bytes = log_pages == moved_pages
                      ? 0
                      : static_cast<std::uint64_t>(log_pages) * (page_size + kFrameHeaderBytes);
    if (log_is_stuck) return tl::unexpected(error);
    return {};
  }

  Result<void> keepLogShort() {
    if (log_bytes > options.wal_limit_bytes) return checkpoint(SQLITE_CHECKPOINT_TRUNCATE);
    if (log_bytes > options.wal_checkpoint_bytes) return checkpoint(SQLITE_CHECKPOINT_PASSIVE);
    return {};
  }

  void notify(std::uint64_t revision, const std::vector<geo::TileKey>& tiles) {
    std::vector<Listener> called;
    {
      const std::lock_guard lock(listeners_mutex);
      for (const auto& [handle, listener] : listeners) called.push_back(listener);
    }
    for (const Listener& listener : called) listener(revision, tiles);
  }
};

MapStore::MapStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MapStore::MapStore(MapStore&&) noexcept = default;
MapStore& MapStore::operator=(MapStore&&) noexcept = default;
MapStore::~MapStore() = default;

Result<MapStore> MapStore::create(const std::filesystem::path& path, const MapMeta& wanted,
                                  const StoreOptions& options) {
  if (const Result<void> fine = checkMeta(wanted); !fine) return tl::unexpected(fine.error());
  if (const auto lattice = geo::TileLattice::parse(wanted.lattice); !lattice)
    return tl::unexpected(lattice.error());
  const Result<detail::FileKind> kind = detail::inspect(path);
  if (!kind) return tl::unexpected(kind.error());
  if (*kind == detail::FileKind::Map)
    return fail(ErrorCode::BadInput,
                fmt::format("{} is a map already; open it, or name another file", path.string()));
  MapMeta meta = wanted;
  if (meta.id.empty()) meta.id = drawId();
  if (meta.created_utc_ns == 0)
    meta.created_utc_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(
                              std::chrono::system_clock::now().time_since_epoch())
                              .count();
  // Made whole beside its place, then moved there: no moment shows half a map.
  const std::filesystem::path fresh = path.string() + ".new";
  for (const char* suffix : {"", "-journal", "-wal", "-shm"}) {
    std::error_code ignored;
    std::filesystem::remove(fresh.string() + suffix, ignored);
  }
  {
    Result<Database> database =
        Database::open(fresh, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, options.vfs, kBusyMs);
    if (!database) return tl::unexpected(database.error());
    if (const Result<void> done = detail::createSchema(*database, meta); !done)
      return tl::unexpected(done.error());
  }
  if (const Result<void> done = moveIntoPlace(fresh, path, *kind == detail::FileKind::Empty); !done)
    return tl::unexpected(done.error());
  return open(path, options);
}

Result<MapStore> MapStore::open(const std::filesystem::path& path, const StoreOptions& options) {
  const Result<detail::FileKind> kind = detail::inspect(path);
  if (!kind) return tl::unexpected(kind.error());
  if (*kind == detail::FileKind::Absent)
    return fail(ErrorCode::NotFound, fmt::format("there is no map at {}", path.string()));
  if (*kind == detail::FileKind::Empty)
    return fail(ErrorCode::BadInput, fmt::format("{} is empty; delete it and map again", path.string()));
  Result<Database> database = Database::open(path, SQLITE_OPEN_READWRITE, options.vfs, kBusyMs);
  if (!database) return tl::unexpected(database.error());
  if (const Result<void> done = detail::checkSchema(*database, path); !done)
    return tl::unexpected(done.error());
  auto impl = std::make_unique<Impl>(path, options, std::move(*database));
  if (const Result<void> done = impl->tune(); !done) return tl::unexpected(done.error());
  if (const Result<void> done = detail::migrate(impl->database, path); !done)
    return tl::unexpected(done.error());
  Result<MapMeta> meta = detail::readMeta(impl->database);
  if (!meta) return tl::unexpected(meta.error());
  impl->meta = std::move(*meta);
  return MapStore(std::move(impl));
}

const std::filesystem::path& MapStore::path() const { return impl_->path; }
const MapMeta& MapStore::meta() const { return impl_->meta; }

Result<void> MapStore::amend(const MapMeta& wanted) {
  if (const Result<void> fine = checkMeta(wanted); !fine) return fine;
  Result<Transaction> transaction = Transaction::begin(impl_->database, Transaction::Kind::Write);
  if (!transaction) return tl::unexpected(transaction.error());
  MapMeta meta = wanted;
  meta.id = impl_->meta.id;
  meta.created_utc_ns = impl_->meta.created_utc_ns;
  const MapMeta& now = impl_->meta;
  const bool same_meaning = meta.lattice == now.lattice && meta.datum == now.datum &&
                            meta.geoid == now.geoid && meta.tile_size == now.tile_size &&
                            meta.base_zoom == now.base_zoom && meta.elevation_step_m == now.elevation_step_m;
  if (!same_meaning) {
    const Result<std::int64_t> tiles =
        impl_->database.integer("SELECT count(*) FROM (SELECT 1 FROM tile LIMIT 1)");
    if (!tiles) return tl::unexpected(tiles.error());
    if (*tiles != 0)
      return fail(ErrorCode::BadInput,
                  "the map has tiles already: its lattice, datum, tile size and zoom stay; begin a new map");
    if (const auto lattice = geo::TileLattice::parse(meta.lattice); !lattice)
      return tl::unexpected(lattice.error());
  }
  if (const Result<void> done = detail::writeMeta(impl_->database, meta); !done) return done;
  if (const Result<void> done = transaction->commit(); !done) return done;
  impl_->meta = meta;
  return {};
}

Result<std::uint64_t> MapStore::commit(const Batch& batch) {
  Impl& impl = *impl_;
  Database& database = impl.database;
  // With a log that can neither be moved nor grow for ever, a commit has to wait for the disk.
  if (impl.log_is_stuck && impl.log_bytes > impl.options.wal_limit_bytes)
    if (const Result<void> done = impl.checkpoint(SQLITE_CHECKPOINT_TRUNCATE); !done)
      return tl::unexpected(done.error());

  Result<Transaction> transaction = Transaction::begin(database, Transaction::Kind::Write);
  if (!transaction) return tl::unexpected(transaction.error());
  const Result<std::uint64_t> before = detail::readRevision(database);
  if (!before) return tl::unexpected(before.error());
  detail::TileWriter writer(database, *before);
  for (const TileWrite& tile : batch.tiles)
    if (const Result<void> done = writer.write(tile); !done) return tl::unexpected(done.error());
  if (const Result<void> done = writer.finish(); !done) return tl::unexpected(done.error());
  for (const FrameRecord& frame : batch.frames)
    if (const Result<void> done = detail::writeFrame(database, frame); !done)
      return tl::unexpected(done.error());
  for (const auto& [key, kind] : batch.dequeue) {
    Query remove = database.query("DELETE FROM queue WHERE kind = ? AND zoom = ? AND x = ? AND y = ?");
    remove.bind(kind).bind(key.zoom).bind(key.x).bind(key.y);
    if (const Result<void> done = remove.run(); !done) return tl::unexpected(done.error());
  }
  for (const QueueEntry& entry : batch.enqueue) {
    Query insert = database.query("INSERT OR REPLACE INTO queue VALUES (?, ?, ?, ?, ?, ?)");
    insert.bind(entry.kind).bind(entry.key.zoom).bind(entry.key.x).bind(entry.key.y);
    insert.bind(entry.priority).bind(std::string_view(entry.detail));
    if (const Result<void> done = insert.run(); !done) return tl::unexpected(done.error());
  }
  for (const auto& [key, value] : batch.values) {
    const std::string full = "user." + key;
    Query change = database.query(value.empty() ? "DELETE FROM meta WHERE key = ?"
                                                : "INSERT OR REPLACE INTO meta VALUES (?, ?)");
    change.bind(std::string_view(full));
    if (!value.empty()) change.bind(std::string_view(value));
    if (const Result<void> done = change.run(); !done) return tl::unexpected(done.error());
  }
  if (const Result<void> done = transaction->commit(); !done) return tl::unexpected(done.error());

  // The batch is safe whatever becomes of the log: a failing checkpoint is met by the next commit.
  (void)impl.keepLogShort();
  if (!writer.changed().empty()) impl.notify(writer.revision(), writer.changed());
  return writer.revision();
}

int MapStore::addListener(Listener listener) {
  const std::lock_guard lock(impl_->listeners_mutex);
  impl_->listeners.emplace(impl_->next_listener, std::move(listener));
  return impl_->next_listener++;
}

void MapStore::removeListener(int handle) {
  const std::lock_guard lock(impl_->listeners_mutex);
  impl_->listeners.erase(handle);
}

Result<MapReader> MapStore::reader() const { return MapReader::open(impl_->path, impl_->options); }

Result<std::uint64_t> MapStore::checkpoint() {
  if (const Result<void> done = impl_->checkpoint(SQLITE_CHECKPOINT_TRUNCATE); !done)
    return tl::unexpected(done.error());
  return impl_->log_bytes;
}

}  // namespace overfly::tiling
