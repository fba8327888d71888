#pragma once
#include <libcamera/framebuffer.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

namespace overfly::capture::lc {

// The planes of a dma-buf in this process's memory, for reading. Move-only.
class MappedBuffer {
 public:
  explicit MappedBuffer(const libcamera::FrameBuffer& buffer) {
    // Planes may share one dma-buf: each is mapped once, to the end of its last plane.
    std::map<int, std::size_t> lengths;
    for (const auto& plane : buffer.planes())
      lengths[plane.fd.get()] =
          std::max<std::size_t>(lengths[plane.fd.get()], std::size_t{plane.offset} + plane.length);
    for (const auto& [fd, length] : lengths) {
      void* address = mmap(nullptr, length, PROT_READ, MAP_SHARED, fd, 0);
      if (address != MAP_FAILED) maps_[fd] = {static_cast<const std::uint8_t*>(address), length};
    }
    for (const auto& plane : buffer.planes()) {
      const auto map = maps_.find(plane.fd.get());
      planes_.push_back(map == maps_.end() ? std::span<const std::uint8_t>()
                                           : map->second.subspan(plane.offset, plane.length));
    }
  }
  MappedBuffer(MappedBuffer&& other) noexcept
      : maps_(std::exchange(other.maps_, {})), planes_(std::move(other.planes_)) {}
  MappedBuffer(const MappedBuffer&) = delete;
  MappedBuffer& operator=(const MappedBuffer&) = delete;
  MappedBuffer& operator=(MappedBuffer&&) = delete;
  ~MappedBuffer() {
    for (const auto& [fd, bytes] : maps_) munmap(const_cast<std::uint8_t*>(bytes.data()), bytes.size());
  }

  // Empty spans where the memory could not be mapped.
  [[nodiscard]] const std::vector<std::span<const std::uint8_t>>& planes() const { return planes_; }

  // What the device wrote is seen by the processor between the two.
  void beginReading() const { sync(DMA_BUF_SYNC_START | DMA_BUF_SYNC_READ); }
  void endReading() const { sync(DMA_BUF_SYNC_END | DMA_BUF_SYNC_READ); }

 private:
  void sync(std::uint64_t flags) const {
    for (const auto& [fd, bytes] : maps_) {
      dma_buf_sync request{flags};
      (void)ioctl(fd, DMA_BUF_IOCTL_SYNC, &request);
    }
  }

  std::map<int, std::span<const std::uint8_t>> maps_;
  std::vector<std::span<const std::uint8_t>> planes_;
};

}  // namespace overfly::capture::lc
