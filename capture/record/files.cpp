#include "capture/record/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

namespace overfly::capture {

FileDescriptor& FileDescriptor::operator=(FileDescriptor&& other) noexcept {
  if (this != &other) {
    if (fd_ >= 0) ::close(fd_);
    fd_ = std::exchange(other.fd_, -1);
  }
  return *this;
}

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) ::close(fd_);
}

tl::unexpected<Error> systemFailure(std::string_view what, const std::filesystem::path& path) {
  const int number = errno;
  const ErrorCode code = number == ENOENT || number == ENOTDIR ? ErrorCode::NotFound : ErrorCode::Io;
  return fail(code, fmt::format("{} {}: {}", what, path.string(), std::generic_category().message(number)));
}

namespace {

template <typename Container>
Result<Container> readInto(const std::filesystem::path& path, std::uint64_t limit) {
  const FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file) return systemFailure("cannot open", path);
  struct stat about {};
  if (::fstat(file.get(), &about) != 0) return systemFailure("cannot read", path);
  if (!S_ISREG(about.st_mode)) return fail(ErrorCode::BadInput, path.string() + " is not a regular file");
  const auto size = static_cast<std::uint64_t>(about.st_size);
  if (size > limit) {
    return fail(ErrorCode::BadInput,
                fmt::format("{} is {} bytes long, more than the {} allowed", path.string(), size, limit));
  }
  Container content;
  content.resize(size);
  std::size_t done = 0;
  while (done < size) {
    const ssize_t got = ::read(file.get(), content.data() + done, size - done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return systemFailure("cannot read", path);
    if (got == 0) break;  // became shorter meanwhile
    done += static_cast<std::size_t>(got);
  }
  content.resize(done);
  return content;
}

}  // namespace

Result<std::vector<std::uint8_t>> readFile(const std::filesystem::path& path, std::uint64_t limit) {
  return readInto<std::vector<std::uint8_t>>(path, limit);
}

Result<std::string> readText(const std::filesystem::path& path, std::uint64_t limit) {
  return readInto<std::string>(path, limit);
}

Result<void> writeAll(int fd, std::span<const std::uint8_t> bytes, const std::filesystem::path& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return systemFailure("cannot write", path);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return {};
}

Result<void> appendWhole(int fd, std::span<const std::uint8_t> bytes, const std::filesystem::path& path) {
  struct stat before {};
  if (::fstat(fd, &before) != 0) return systemFailure("cannot write", path);
  auto written = writeAll(fd, bytes, path);
  if (!written && ::ftruncate(fd, before.st_size) != 0) return systemFailure("cannot shorten", path);
  return written;
}

Result<FileDescriptor> replaceFile(const std::filesystem::path& path, std::span<const std::uint8_t> bytes) {
  const std::filesystem::path temporary = path.parent_path() / ("." + path.filename().string() + ".tmp");
  FileDescriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!file) return systemFailure("cannot create", temporary);
  if (auto written = writeAll(file.get(), bytes, temporary); !written) {
    ::unlink(temporary.c_str());
    return tl::unexpected(written.error());
  }
  if (::rename(temporary.c_str(), path.c_str()) != 0) {
    auto failure = systemFailure("cannot rename to", path);
    ::unlink(temporary.c_str());
    return failure;
  }
  return file;
}

std::span<const std::uint8_t> bytesOf(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::uint32_t crc32Of(std::span<const std::uint8_t> bytes) {
  uLong crc = ::crc32(0, nullptr, 0);
  while (!bytes.empty()) {
    const auto part = bytes.first(std::min<std::size_t>(bytes.size(), 1U << 30));
    crc = ::crc32(crc, part.data(), static_cast<uInt>(part.size()));
    bytes = bytes.subspan(part.size());
  }
  return static_cast<std::uint32_t>(crc);
}

}  // namespace overfly::capture
