#pragma once
#include <filesystem>

#include "config/error.h"
#include "tiling/store/detail/sqlite.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling::detail {

inline constexpr int kApplicationId = 0x4F464C59;  // "OFLY"
inline constexpr int kSchemaVersion = 1;

// What the first bytes of a file say, before SQLite touches it.
enum class FileKind { Absent, Empty, Map };
// BadInput for a foreign file, Io when it cannot be read.
[[nodiscard]] Result<FileKind> inspect(const std::filesystem::path& path);

// Makes the tables in an empty database, in one transaction, and switches it to WAL.
[[nodiscard]] Result<void> createSchema(Database& database, const MapMeta& meta);
// Compares application id, schema version, file size and tables; BadInput or Corrupt with advice.
[[nodiscard]] Result<void> checkSchema(Database& database, const std::filesystem::path& path);
// Brings an older schema to kSchemaVersion, one transaction per version.
[[nodiscard]] Result<void> migrate(Database& database, const std::filesystem::path& path);

[[nodiscard]] Result<MapMeta> readMeta(Database& database);
[[nodiscard]] Result<void> writeMeta(Database& database, const MapMeta& meta);
[[nodiscard]] Result<std::uint64_t> readRevision(Database& database);

}  // namespace overfly::tiling::detail
