#include "tests/stress/store/fault_vfs.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>

namespace overfly::tiling {
namespace {

sqlite3_vfs* system() {
  static sqlite3_vfs* const vfs = sqlite3_vfs_find(nullptr);
  return vfs;
}

struct File {
  sqlite3_file base;
  std::string* path;
  sqlite3_file* real;  // behind this struct
};
File* own(sqlite3_file* file) { return reinterpret_cast<File*>(file); }
sqlite3_file* real(sqlite3_file* file) { return own(file)->real; }

int codeOf(FaultVfs::Fault fault, int io_error) {
  return fault == FaultVfs::Fault::Error ? io_error : SQLITE_FULL;
}

int fileClose(sqlite3_file* file) {
  const int code = real(file)->pMethods != nullptr ? real(file)->pMethods->xClose(real(file)) : SQLITE_OK;
  delete own(file)->path;
  return code;
}
int fileRead(sqlite3_file* file, void* to, int count, sqlite3_int64 offset) {
  return real(file)->pMethods->xRead(real(file), to, count, offset);
}
int fileWrite(sqlite3_file* file, const void* from, int count, sqlite3_int64 offset) {
  FaultVfs& faults = FaultVfs::instance();
  const FaultVfs::Fault fault = faults.next(false, static_cast<std::uint64_t>(count));
  if (fault == FaultVfs::Fault::DiskFull || fault == FaultVfs::Fault::Error)
    return codeOf(fault, SQLITE_IOERR_WRITE);
  const int written = fault == FaultVfs::Fault::ShortWrite ? count / 2 : count;
  sqlite3_int64 size = 0;
  real(file)->pMethods->xFileSize(real(file), &size);
  FaultVfs::Write write{offset, {}, {}};
  const auto* bytes = static_cast<const std::uint8_t*>(from);
  write.after.assign(bytes, bytes + written);
  if (offset < size) {
    write.before.resize(static_cast<std::size_t>(std::min<sqlite3_int64>(written, size - offset)));
    real(file)->pMethods->xRead(real(file), write.before.data(), static_cast<int>(write.before.size()),
                                offset);
  }
  faults.remember(*own(file)->path, std::move(write), size);
  const int code = real(file)->pMethods->xWrite(real(file), from, written, offset);
  return written < count ? SQLITE_FULL : code;
}
int fileTruncate(sqlite3_file* file, sqlite3_int64 size) {
  const FaultVfs::Fault fault = FaultVfs::instance().next(false, 0);
  if (fault != FaultVfs::Fault::None) return codeOf(fault, SQLITE_IOERR_TRUNCATE);
  return real(file)->pMethods->xTruncate(real(file), size);
}
int fileSync(sqlite3_file* file, int flags) {
  const FaultVfs::Fault fault = FaultVfs::instance().next(true, 0);
  if (fault != FaultVfs::Fault::None) return codeOf(fault, SQLITE_IOERR_FSYNC);
  FaultVfs::instance().synced(*own(file)->path);
  return real(file)->pMethods->xSync(real(file), flags);
}
int fileSize(sqlite3_file* file, sqlite3_int64* size) {
  return real(file)->pMethods->xFileSize(real(file), size);
}
int fileLock(sqlite3_file* file, int level) { return real(file)->pMethods->xLock(real(file), level); }
int fileUnlock(sqlite3_file* file, int level) { return real(file)->pMethods->xUnlock(real(file), level); }
int fileReserved(sqlite3_file* file, int* out) {
  return real(file)->pMethods->xCheckReservedLock(real(file), out);
}
int fileControl(sqlite3_file* file, int what, void* with) {
  // Would let SQLite write behind our back.
  if (what == SQLITE_FCNTL_MMAP_SIZE || what == SQLITE_FCNTL_CHUNK_SIZE || what == SQLITE_FCNTL_SIZE_HINT)
    return SQLITE_NOTFOUND;
  return real(file)->pMethods->xFileControl(real(file), what, with);
}
int fileSector(sqlite3_file* file) { return real(file)->pMethods->xSectorSize(real(file)); }
int fileDevice(sqlite3_file* file) { return real(file)->pMethods->xDeviceCharacteristics(real(file)); }
int shmMap(sqlite3_file* file, int page, int size, int extend, void volatile** at) {
  return real(file)->pMethods->xShmMap(real(file), page, size, extend, at);
}
int shmLock(sqlite3_file* file, int offset, int count, int flags) {
  return real(file)->pMethods->xShmLock(real(file), offset, count, flags);
}
void shmBarrier(sqlite3_file* file) { real(file)->pMethods->xShmBarrier(real(file)); }
int shmUnmap(sqlite3_file* file, int remove) { return real(file)->pMethods->xShmUnmap(real(file), remove); }

const sqlite3_io_methods kMethods = {2,           fileClose,  fileRead,   fileWrite,  fileTruncate,
                                     fileSync,    fileSize,   fileLock,   fileUnlock, fileReserved,
                                     fileControl, fileSector, fileDevice, shmMap,     shmLock,
                                     shmBarrier,  shmUnmap,   nullptr,    nullptr};

int vfsOpen(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out_flags) {
  File* const self = own(file);
  self->real = reinterpret_cast<sqlite3_file*>(self + 1);
  self->real->pMethods = nullptr;
  self->path = new std::string(name != nullptr ? name : "");
  const int code = system()->xOpen(system(), name, self->real, flags, out_flags);
  self->base.pMethods = code == SQLITE_OK ? &kMethods : nullptr;
  if (code != SQLITE_OK) delete self->path;
  return code;
}
int vfsDelete(sqlite3_vfs*, const char* name, int sync_folder) {
  const FaultVfs::Fault fault = FaultVfs::instance().next(false, 0);
  if (fault != FaultVfs::Fault::None) return codeOf(fault, SQLITE_IOERR_DELETE);
  FaultVfs::instance().forget(name);
  return system()->xDelete(system(), name, sync_folder);
}
int vfsAccess(sqlite3_vfs*, const char* name, int flags, int* out) {
  return system()->xAccess(system(), name, flags, out);
}
int vfsFull(sqlite3_vfs*, const char* name, int count, char* out) {
  return system()->xFullPathname(system(), name, count, out);
}

void put(int descriptor, std::int64_t offset, const std::uint8_t* bytes, std::size_t count) {
  while (count > 0) {
    const ssize_t done = pwrite(descriptor, bytes, count, offset);
    if (done <= 0) return;
    bytes += done;
    offset += done;
    count -= static_cast<std::size_t>(done);
  }
}

}  // namespace

FaultVfs& FaultVfs::instance() {
  static FaultVfs faults;
  return faults;
}

FaultVfs::FaultVfs() {
  static sqlite3_vfs vfs = *system();
  vfs.zName = kName;
  vfs.pNext = nullptr;
  vfs.szOsFile = static_cast<int>(sizeof(File)) + system()->szOsFile;
  vfs.xOpen = vfsOpen;
  vfs.xDelete = vfsDelete;
  vfs.xAccess = vfsAccess;
  vfs.xFullPathname = vfsFull;
  sqlite3_vfs_register(&vfs, 0);
}

void FaultVfs::reset() {
  const std::lock_guard lock(mutex_);
  operations_ = syncs_ = bytes_ = 0;
  at_ = UINT64_MAX;
  lasting_ = false;
  unsynced_.clear();
}

void FaultVfs::plan(std::uint64_t at, Fault fault, bool lasting) {
  const std::lock_guard lock(mutex_);
  at_ = at;
  fault_ = fault;
  lasting_ = lasting;
}

void FaultVfs::planPowerCut(std::uint64_t at) { plan(at, Fault::Error, true); }

void FaultVfs::heal() { plan(UINT64_MAX, Fault::None, false); }

std::uint64_t FaultVfs::operations() const {
  const std::lock_guard lock(mutex_);
  return operations_;
}
std::uint64_t FaultVfs::syncs() const {
  const std::lock_guard lock(mutex_);
  return syncs_;
}
std::uint64_t FaultVfs::bytesWritten() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

FaultVfs::Fault FaultVfs::next(bool is_sync, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t now = operations_++;
  syncs_ += is_sync ? 1 : 0;
  bytes_ += bytes;
  return now == at_ || (lasting_ && now > at_) ? fault_ : Fault::None;
}

void FaultVfs::remember(const std::string& path, Write write, std::int64_t size_before) {
  const std::lock_guard lock(mutex_);
  Unsynced& file = unsynced_[path];
  if (!file.known) {
    file.known = true;
    file.synced_size = size_before;
  }
  file.writes.push_back(std::move(write));
}

void FaultVfs::synced(const std::string& path) {
  const std::lock_guard lock(mutex_);
  unsynced_.erase(path);
}

void FaultVfs::forget(const std::string& path) { synced(path); }

void FaultVfs::powerCut(std::mt19937& random) {
  constexpr std::size_t kSector = 512;
  const std::lock_guard lock(mutex_);
  for (const auto& [path, file] : unsynced_) {
    const int descriptor = open(path.c_str(), O_RDWR | O_CLOEXEC);
    if (descriptor < 0) continue;
    for (auto write = file.writes.rbegin(); write != file.writes.rend(); ++write)
      put(descriptor, write->offset, write->before.data(), write->before.size());
    if (ftruncate(descriptor, file.synced_size) != 0) std::abort();
    // 0: nothing reached the disk, 100: everything, else any sector by chance.
    const unsigned share = std::array{0U, 20U, 50U, 80U, 100U}[random() % 5];
    for (const Write& write : file.writes)
      for (std::size_t from = 0; from < write.after.size(); from += kSector)
        if (random() % 100 < share)
          put(descriptor, write.offset + static_cast<std::int64_t>(from), write.after.data() + from,
              std::min(kSector, write.after.size() - from));
    close(descriptor);
  }
  unsynced_.clear();
}

}  // namespace overfly::tiling
