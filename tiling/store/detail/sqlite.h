#pragma once
#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "config/error.h"

namespace overfly::tiling::detail {

// SQLite's result code as an error: Corrupt for a damaged file, Io for what the disk refused (the message
// names errno's text), Unavailable for a lock that was not to be had, Internal for a mistake of ours.
[[nodiscard]] Error sqliteError(sqlite3* database, int code, std::string_view doing);

// A prepared statement in use: binds from the first parameter on, steps, and resets at its end. Borrowed
// from a Database, which keeps it prepared; at most one Query per SQL text at a time.
class Query {
 public:
  Query(sqlite3* database, sqlite3_stmt* statement, int prepare_code);
  Query(Query&& other) noexcept;
  Query& operator=(Query&&) = delete;
  ~Query();

  Query& bind(std::int64_t value);
  Query& bind(std::uint64_t value) { return bind(static_cast<std::int64_t>(value)); }
  Query& bind(int value) { return bind(std::int64_t{value}); }
  Query& bind(double value);
  Query& bind(std::string_view text);                // must outlive the query
  Query& bind(std::span<const std::uint8_t> bytes);  // must outlive the query
  Query& bindNull();

  // True: a row is there. False: the end.
  [[nodiscard]] Result<bool> step();
  // Steps to the end, for statements without rows.
  [[nodiscard]] Result<void> run();

  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double real(int column) const;
  [[nodiscard]] bool isNull(int column) const;
  [[nodiscard]] std::string text(int column) const;
  [[nodiscard]] std::span<const std::uint8_t> blob(int column) const;  // until the next step

 private:
  sqlite3* database_;
  sqlite3_stmt* statement_;
  int code_;
  int next_ = 1;
};

// One connection. Move-only; one thread at a time.
class Database {
 public:
  // `flags` as for sqlite3_open_v2. A busy lock is waited for up to `busy_ms`.
  [[nodiscard]] static Result<Database> open(const std::filesystem::path& path, int flags,
                                             const std::string& vfs, int busy_ms);
  // A file that nobody writes, on a medium that cannot be written: no locks, no log.
  [[nodiscard]] static Result<Database> openImmutable(const std::filesystem::path& path);
  Database(Database&&) noexcept = default;
  Database& operator=(Database&&) noexcept = default;

  [[nodiscard]] Query query(std::string_view literal);
  [[nodiscard]] Result<void> execute(const char* sql);
  [[nodiscard]] Result<std::int64_t> integer(const char* sql);
  [[nodiscard]] sqlite3* handle() const { return handle_.get(); }

 private:
  struct Close {
    void operator()(sqlite3* handle) const { sqlite3_close_v2(handle); }
  };
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  [[nodiscard]] static Result<Database> openName(const std::string& name, int flags, const char* vfs,
                                                 int busy_ms, const std::filesystem::path& path);
  Database() = default;
  std::unique_ptr<sqlite3, Close> handle_;
  std::unordered_map<std::string_view, std::unique_ptr<sqlite3_stmt, Finalize>> statements_;
};

// BEGIN ... COMMIT; rolls back unless committed. A read transaction holds its snapshot only while it lives.
class Transaction {
 public:
  enum class Kind { Read, Write };
  [[nodiscard]] static Result<Transaction> begin(Database& database, Kind kind);
  Transaction(Transaction&& other) noexcept;
  Transaction& operator=(Transaction&&) = delete;
  ~Transaction();
  [[nodiscard]] Result<void> commit();

 private:
  explicit Transaction(Database& database) : database_(&database) {}
  Database* database_;
};

}  // namespace overfly::tiling::detail
