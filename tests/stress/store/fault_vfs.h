#pragma once
#include <cstdint>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <vector>

namespace overfly::tiling {

// A layer under SQLite that passes everything on to the system's files, and fails or tears the operation
// that it is told to. It also remembers what was written since the last sync of each file, so that a power
// cut can be played: of the writes that were not synced any part may be on the disk, in sectors.
class FaultVfs {
 public:
  enum class Fault {
    None,
    DiskFull,    // ENOSPC, nothing written
    Error,       // EIO, nothing written
    ShortWrite,  // half of it written, then ENOSPC
  };
  static constexpr const char* kName = "overfly-fault";

  // Registers the VFS with SQLite once per process.
  static FaultVfs& instance();

  // Begins anew: no fault, counters at zero, no memory of writes.
  void reset();
  // The operation number `at` (from 0; writes, syncs, truncations and deletions count) gets `fault`; with
  // `lasting`, so do all operations after it until heal().
  void plan(std::uint64_t at, Fault fault, bool lasting);
  void heal();
  [[nodiscard]] std::uint64_t operations() const;
  [[nodiscard]] std::uint64_t syncs() const;
  [[nodiscard]] std::uint64_t bytesWritten() const;

  // Everything fails from operation `at` on; after closing the map, powerCut() leaves in the files what a
  // disk may have kept.
  void planPowerCut(std::uint64_t at);
  void powerCut(std::mt19937& random);

  // For the file methods.
  struct Write {
    std::int64_t offset;
    std::vector<std::uint8_t> before, after;  // `before` is short where the file ended
  };
  struct Unsynced {
    std::int64_t synced_size = 0;
    bool known = false;
    std::vector<Write> writes;
  };
  Fault next(bool is_sync, std::uint64_t bytes);
  void remember(const std::string& path, Write write, std::int64_t size_before);
  void synced(const std::string& path);
  void forget(const std::string& path);

 private:
  FaultVfs();
  mutable std::mutex mutex_;
  std::uint64_t operations_ = 0, syncs_ = 0, bytes_ = 0;
  std::uint64_t at_ = UINT64_MAX;
  Fault fault_ = Fault::None;
  bool lasting_ = false;
  std::map<std::string, Unsynced> unsynced_;
};

}  // namespace overfly::tiling
