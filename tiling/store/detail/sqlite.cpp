#include "tiling/store/detail/sqlite.h"

#include <fmt/format.h>

#include <cstring>
#include <utility>

namespace overfly::tiling::detail {

Error sqliteError(sqlite3* database, int code, std::string_view doing) {
  const int primary = code & 0xff;
  ErrorCode kind = ErrorCode::Internal;
  switch (primary) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
    case SQLITE_FORMAT:
      kind = ErrorCode::Corrupt;
      break;
    case SQLITE_FULL:
    case SQLITE_IOERR:
    case SQLITE_CANTOPEN:
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_AUTH:
    case SQLITE_NOMEM:
    case SQLITE_PROTOCOL:
    case SQLITE_NOLFS:
      kind = ErrorCode::Io;
      break;
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      kind = ErrorCode::Unavailable;
      break;
    default:
      break;
  }
  std::string what = primary == SQLITE_FULL ? "the disk is full" : sqlite3_errstr(code);
  const int system = database != nullptr ? sqlite3_system_errno(database) : 0;
  if (kind == ErrorCode::Io && primary != SQLITE_FULL && system != 0)
    what += fmt::format(" ({})", std::strerror(system));
  if (kind == ErrorCode::Internal && database != nullptr)
    what += fmt::format(" ({})", sqlite3_errmsg(database));
  return {kind, fmt::format("{}: {}", doing, what)};
}

Query::Query(sqlite3* database, sqlite3_stmt* statement, int prepare_code)
    : database_(database), statement_(statement), code_(prepare_code) {}

Query::Query(Query&& other) noexcept
    : database_(other.database_),
      statement_(std::exchange(other.statement_, nullptr)),
      code_(other.code_),
      next_(other.next_) {}

Query::~Query() {
  if (statement_ == nullptr) return;
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
}

Query& Query::bind(std::int64_t value) {
  if (code_ == SQLITE_OK) code_ = sqlite3_bind_int64(statement_, next_++, value);
  return *this;
}
Query& Query::bind(double value) {
  if (code_ == SQLITE_OK) code_ = sqlite3_bind_double(statement_, next_++, value);
  return *this;
}
Query& Query::bind(std::string_view text) {
  if (code_ == SQLITE_OK)
    code_ = sqlite3_bind_text64(statement_, next_++, text.data() != nullptr ? text.data() : "", text.size(),
                                SQLITE_STATIC, SQLITE_UTF8);
  return *this;
}
Query& Query::bind(std::span<const std::uint8_t> bytes) {
  static constexpr std::uint8_t kEmpty = 0;  // a null pointer would bind NULL
  if (code_ == SQLITE_OK)
    code_ = sqlite3_bind_blob64(statement_, next_++, bytes.empty() ? &kEmpty : bytes.data(), bytes.size(),
                                SQLITE_STATIC);
  return *this;
}
Query& Query::bindNull() {
  if (code_ == SQLITE_OK) code_ = sqlite3_bind_null(statement_, next_++);
  return *this;
}

Result<bool> Query::step() {
  if (code_ != SQLITE_OK) return tl::unexpected(sqliteError(database_, code_, "the map's file"));
  const int code = sqlite3_step(statement_);
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  return tl::unexpected(sqliteError(database_, sqlite3_extended_errcode(database_), "the map's file"));
}

Result<void> Query::run() {
  for (;;) {
    const Result<bool> row = step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) return {};
  }
}

std::int64_t Query::integer(int column) const { return sqlite3_column_int64(statement_, column); }
double Query::real(int column) const { return sqlite3_column_double(statement_, column); }
bool Query::isNull(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }
std::string Query::text(int column) const {
  const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  return bytes == nullptr
             ? std::string()
             : std::string(bytes, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
}
std::span<const std::uint8_t> Query::blob(int column) const {
  const auto* bytes = static_cast<const std::uint8_t*>(sqlite3_column_blob(statement_, column));
  return {bytes, bytes == nullptr ? 0 : static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))};
}

Result<Database> Database::openName(const std::string& name, int flags, const char* vfs, int busy_ms,
                                    const std::filesystem::path& path) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(name.c_str(), &handle, flags | SQLITE_OPEN_NOMUTEX, vfs);
  Database database;
  database.handle_.reset(handle);
  if (code != SQLITE_OK) return tl::unexpected(sqliteError(handle, code, path.string()));
  sqlite3_extended_result_codes(handle, 1);
  sqlite3_busy_timeout(handle, busy_ms);
  return database;
}

Result<Database> Database::open(const std::filesystem::path& path, int flags, const std::string& vfs,
                                int busy_ms) {
  // A name that begins with "file:" would be taken for a URI by some builds of SQLite.
  const std::string name = path.is_absolute() ? path.string() : "./" + path.string();
  return openName(name, flags, vfs.empty() ? nullptr : vfs.c_str(), busy_ms, path);
}

Result<Database> Database::openImmutable(const std::filesystem::path& path) {
  std::error_code ignored;
  std::string uri = "file://";
  for (const char character : std::filesystem::absolute(path, ignored).string()) {
    const auto byte = static_cast<unsigned char>(character);
    if (std::isalnum(byte) != 0 || std::strchr("/-_.~", character) != nullptr)
      uri += character;
    else
      uri += fmt::format("%{:02X}", byte);
  }
  return openName(uri + "?immutable=1", SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, nullptr, 0, path);
}

Query Database::query(std::string_view literal) {
  auto& statement = statements_[literal];
  int code = SQLITE_OK;
  if (!statement) {
    sqlite3_stmt* fresh = nullptr;
    code = sqlite3_prepare_v3(handle_.get(), literal.data(), static_cast<int>(literal.size()),
                              SQLITE_PREPARE_PERSISTENT, &fresh, nullptr);
    if (code != SQLITE_OK) code = sqlite3_extended_errcode(handle_.get());
    statement.reset(fresh);
  }
  return {handle_.get(), statement.get(), code};
}

Result<void> Database::execute(const char* sql) {
  if (sqlite3_exec(handle_.get(), sql, nullptr, nullptr, nullptr) != SQLITE_OK)
    return tl::unexpected(
        sqliteError(handle_.get(), sqlite3_extended_errcode(handle_.get()), "the map's file"));
  return {};
}

Result<std::int64_t> Database::integer(const char* sql) {
  Query rows = query(sql);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return fail(ErrorCode::NotFound, "the map's file: no such value");
  return rows.integer(0);
}

Result<Transaction> Transaction::begin(Database& database, Kind kind) {
  // The first read of a deferred transaction takes the snapshot.
  const Result<void> begun = database.query(kind == Kind::Write ? "BEGIN IMMEDIATE" : "BEGIN").run();
  if (!begun) return tl::unexpected(begun.error());
  return Transaction(database);
}

Transaction::Transaction(Transaction&& other) noexcept : database_(std::exchange(other.database_, nullptr)) {}

Transaction::~Transaction() {
  // After some errors SQLite has rolled back by itself.
  if (database_ != nullptr && sqlite3_get_autocommit(database_->handle()) == 0)
    sqlite3_exec(database_->handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

Result<void> Transaction::commit() {
  Result<void> done = database_->query("COMMIT").run();
  if (done) database_ = nullptr;
  return done;
}

}  // namespace overfly::tiling::detail
