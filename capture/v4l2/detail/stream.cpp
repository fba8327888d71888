#include "capture/v4l2/detail/stream.h"

#include <fmt/format.h>
#include <linux/videodev2.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>

namespace overfly::capture::v4l2 {
namespace {

// v4l2_buffer of either API; one plane is all that setMode() agrees to.
struct Buffer {
  v4l2_buffer buffer{};
  v4l2_plane plane{};

  Buffer(const Node& node, std::uint32_t index) {
    buffer.type = node.planes() ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    buffer.index = index;
    if (node.planes()) {
      buffer.m.planes = &plane;
      buffer.length = 1;
    }
  }
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;

  [[nodiscard]] bool planar() const { return buffer.type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE; }
  [[nodiscard]] std::size_t length() const { return planar() ? plane.length : buffer.length; }
  [[nodiscard]] std::size_t offset() const { return planar() ? plane.m.mem_offset : buffer.m.offset; }
  // Where the picture begins and ends within the buffer.
  [[nodiscard]] std::size_t begin() const { return planar() ? plane.data_offset : 0; }
  [[nodiscard]] std::size_t end() const { return planar() ? plane.bytesused : buffer.bytesused; }
};

}  // namespace

Result<Stream> Stream::start(Node node, const LiveCameraOptions& options) {
  auto mode = setMode(node, options);
  if (!mode) return tl::unexpected(mode.error());
  Controls controls = setControls(node, options);
  Stream stream(std::move(node), *mode, std::move(controls));
  if (auto ok = stream.makeBuffers(options.buffers); !ok) return tl::unexpected(ok.error());
  int type =
      Buffer(stream.node_, 0).planar() ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (const int error = stream.node_.call(VIDIOC_STREAMON, type); error != 0)
    return stream.node_.failed("start streaming", error);
  stream.streaming_ = true;
  return stream;
}

Result<void> Stream::makeBuffers(int wanted) {
  v4l2_requestbuffers request{};
  request.count = static_cast<__u32>(wanted);
  request.type = node_.planes() ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
  request.memory = V4L2_MEMORY_MMAP;
  if (const int error = node_.call(VIDIOC_REQBUFS, request); error != 0)
    return node_.failed("make buffers", error);
  if (request.count < 2)
    return fail(ErrorCode::Io, fmt::format("{} makes {} buffers, two are needed: set camera.buffers or a "
                                           "smaller picture",
                                           node_.path(), request.count));
  for (std::uint32_t i = 0; i < request.count; ++i) {
    Buffer buffer(node_, i);
    if (const int error = node_.call(VIDIOC_QUERYBUF, buffer.buffer); error != 0)
      return node_.failed("show its buffers", error);
    void* address = node_.kernel().map(node_.fd(), buffer.length(), buffer.offset());
    if (address == MAP_FAILED) return node_.failed("map its buffers", errno);
    mappings_.push_back({address, buffer.length()});
    if (auto ok = giveBack(i); !ok) return ok;
  }
  return {};
}

Stream::~Stream() {
  if (node_.fd() < 0) return;
  int type = node_.planes() ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (streaming_) (void)node_.call(VIDIOC_STREAMOFF, type);
  for (const Mapping& mapping : mappings_) node_.kernel().unmap(mapping.address, mapping.length);
}

Result<std::optional<Taken>> Stream::take() {
  Buffer buffer(node_, 0);
  if (const int error = node_.call(VIDIOC_DQBUF, buffer.buffer); error != 0) {
    if (error == EAGAIN) return std::nullopt;
    return node_.failed("hand over a picture", error);
  }
  if (buffer.buffer.index >= mappings_.size())
    return fail(ErrorCode::Io, fmt::format("{} hands over a buffer that it never had", node_.path()));
  const Mapping& mapping = mappings_[buffer.buffer.index];
  const std::size_t end = std::min(buffer.end(), mapping.length), begin = std::min(buffer.begin(), end);
  Taken taken;
  taken.index = buffer.buffer.index;
  taken.bytes = {static_cast<const std::uint8_t*>(mapping.address) + begin, end - begin};
  taken.sequence = buffer.buffer.sequence;
  const __u32 flags = buffer.buffer.flags;
  if ((flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC) {
    const timeval& stamp = buffer.buffer.timestamp;
    taken.stamp_ns = std::int64_t{stamp.tv_sec} * 1'000'000'000 + std::int64_t{stamp.tv_usec} * 1'000;
  }
  taken.at_start = (flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  taken.damaged = (flags & V4L2_BUF_FLAG_ERROR) != 0 || taken.bytes.empty();
  return taken;
}

Result<void> Stream::giveBack(std::uint32_t index) {
  Buffer buffer(node_, index);
  if (const int error = node_.call(VIDIOC_QBUF, buffer.buffer); error != 0)
    return node_.failed("take a buffer back", error);
  return {};
}

}  // namespace overfly::capture::v4l2
