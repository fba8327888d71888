#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "config/error.h"

// Small file helpers of the recorder and the importers. All errors name the path and the system's reason.
namespace overfly::capture {

// Owns a file descriptor. Move-only.
class FileDescriptor {
 public:
  FileDescriptor() = default;
  explicit FileDescriptor(int fd) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept;
  ~FileDescriptor();
  [[nodiscard]] int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

// The whole of a regular file. NotFound: absent; BadInput: not a regular file (a pipe would wait for ever) or
// larger than `limit` bytes; Io.
[[nodiscard]] Result<std::vector<std::uint8_t>> readFile(const std::filesystem::path& path,
                                                         std::uint64_t limit);
[[nodiscard]] Result<std::string> readText(const std::filesystem::path& path, std::uint64_t limit);

// Writes everything, going on after interruptions and short writes. Io.
[[nodiscard]] Result<void> writeAll(int fd, std::span<const std::uint8_t> bytes,
                                    const std::filesystem::path& path);

// Appends one record to a file opened with O_APPEND: all of it, or (disk full) the file keeps its old length,
// so that what is appended later is not glued to a torn record. Io.
[[nodiscard]] Result<void> appendWhole(int fd, std::span<const std::uint8_t> bytes,
                                       const std::filesystem::path& path);

// Puts a file there whole or not at all: a hidden temporary file beside it, then rename. The descriptor of
// the new file, still open for a later fdatasync. Io.
[[nodiscard]] Result<FileDescriptor> replaceFile(const std::filesystem::path& path,
                                                 std::span<const std::uint8_t> bytes);

[[nodiscard]] std::span<const std::uint8_t> bytesOf(std::string_view text);

[[nodiscard]] std::uint32_t crc32Of(std::span<const std::uint8_t> bytes);

// An error of the last system call: "<what> <path>: <reason>".
[[nodiscard]] tl::unexpected<Error> systemFailure(std::string_view what, const std::filesystem::path& path);

}  // namespace overfly::capture
