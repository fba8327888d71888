#pragma once
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "capture/v4l2/kernel.h"

namespace overfly::capture::v4l2 {

// A camera driver as far as V4l2Source can see one: /dev/video0, frames at a steady pace, faults on demand.
// What it does is what the V4L2 documentation says of drivers; the compliance suite also takes the
// kernel's own.
class FakeKernel final : public Kernel {
 public:
  using Clock = std::chrono::steady_clock;
  struct Format {
    std::uint32_t fourcc;
    std::vector<std::pair<__u32, __u32>> sizes;  // empty: the driver does not say
  };

  // What the driver has; set before or between calls.
  std::vector<Format> formats{{V4L2_PIX_FMT_GREY, {{64, 48}, {32, 24}}}};
  std::chrono::milliseconds interval{5};
  bool planes = false;                  // multi-planar API
  bool at_start = false;                // stamps the exposure's start
  bool stamps = true;                   // gives monotonic stamps
  int open_error = 0;                   // errno of open()
  std::map<unsigned long, int> errors;  // errno by ioctl
  std::map<std::uint32_t, std::pair<int, int>> control_ranges;
  std::uint32_t capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::uint32_t first_sequence = 0;

  // What tests look at.
  std::map<std::uint32_t, int> controls;
  int opened = 0, mapped = 0;

  // A cable is pulled, or put in again: from any thread.
  void plug(bool in) {
    const std::scoped_lock lock(mutex_);
    plugged_ = in;
    if (!in) streaming_ = false;
  }
  // The next `frames` pictures find no buffer or are damaged.
  void drop(std::uint32_t frames) {
    const std::scoped_lock lock(mutex_);
    sequence_ += frames;
  }
  void damageNext() {
    const std::scoped_lock lock(mutex_);
    damage_ = true;
  }

  int open(const char* path) override {
    const std::scoped_lock lock(mutex_);
    if (std::string(path) != "/dev/video0" || !plugged_) return failWith(ENOENT);
    if (open_error != 0) return failWith(open_error);
    ++opened;
    alive_ = true;
    return kFd;
  }
  int close(int) override {
    const std::scoped_lock lock(mutex_);
    --opened;
    streaming_ = false;
    queued_.clear();
    return 0;
  }
  void* map(int, std::size_t length, std::size_t offset) override {
    const std::scoped_lock lock(mutex_);
    const std::size_t index = offset / kOffset;
    if (index >= memory_.size() || length > memory_[index].size()) {
      errno = EINVAL;
      return MAP_FAILED;
    }
    ++mapped;
    return memory_[index].data();
  }
  int unmap(void*, std::size_t) override {
    const std::scoped_lock lock(mutex_);
    --mapped;
    return 0;
  }

  int poll(pollfd* fds, unsigned count, int timeout_ms) override {
    const auto deadline = Clock::now() + std::chrono::milliseconds(timeout_ms);
    for (;;) {
      for (unsigned i = 0; i < count; ++i) {
        if (fds[i].fd != kFd) {
          if (::poll(fds + i, 1, 0) > 0) return 1;
          continue;
        }
        const std::scoped_lock lock(mutex_);
        fds[i].revents = 0;
        if (!plugged_ || !alive_) fds[i].revents = POLLERR | POLLHUP;
        if (due()) fds[i].revents = POLLIN;
        if (fds[i].revents != 0) return 1;
      }
      if (Clock::now() >= deadline) return 0;
      ::poll(nullptr, 0, 1);
    }
  }

  int ioctl(int, unsigned long request, void* argument) override {
    const std::scoped_lock lock(mutex_);
    if (!plugged_) alive_ = false;
    if (!alive_) return failWith(ENODEV);
    if (const auto error = errors.find(request); error != errors.end()) return failWith(error->second);
    switch (request) {
      case VIDIOC_QUERYCAP: {
        auto& out = *static_cast<v4l2_capability*>(argument);
        std::strcpy(reinterpret_cast<char*>(out.card), "Fake camera");
        std::strcpy(reinterpret_cast<char*>(out.driver), "fake");
        out.capabilities = V4L2_CAP_DEVICE_CAPS;
        out.device_caps = capabilities;
        if (planes) out.device_caps = V4L2_CAP_VIDEO_CAPTURE_MPLANE | V4L2_CAP_STREAMING;
        return 0;
      }
      case VIDIOC_ENUM_FMT: {
        auto& out = *static_cast<v4l2_fmtdesc*>(argument);
        if (out.index >= formats.size()) return failWith(EINVAL);
        out.pixelformat = formats[out.index].fourcc;
        return 0;
      }
      case VIDIOC_ENUM_FRAMESIZES: {
        auto& out = *static_cast<v4l2_frmsizeenum*>(argument);
        for (const Format& format : formats) {
          if (format.fourcc != out.pixel_format || out.index >= format.sizes.size()) continue;
          out.type = V4L2_FRMSIZE_TYPE_DISCRETE;
          out.discrete = {format.sizes[out.index].first, format.sizes[out.index].second};
          return 0;
        }
        return failWith(EINVAL);
      }
      case VIDIOC_G_FMT:
        get(*static_cast<v4l2_format*>(argument));
        return 0;
      case VIDIOC_S_FMT:
        set(*static_cast<v4l2_format*>(argument));
        return 0;
      case VIDIOC_REQBUFS: {
        auto& asked = *static_cast<v4l2_requestbuffers*>(argument);
        memory_.assign(asked.count, std::vector<std::uint8_t>(sizeOfImage()));
        return 0;
      }
      case VIDIOC_QUERYBUF: {
        auto& out = *static_cast<v4l2_buffer*>(argument);
        if (out.index >= memory_.size()) return failWith(EINVAL);
        if (planes) {
          out.m.planes[0].length = static_cast<__u32>(memory_[out.index].size());
          out.m.planes[0].m.mem_offset = static_cast<__u32>(out.index * kOffset);
        } else {
          out.length = static_cast<__u32>(memory_[out.index].size());
          out.m.offset = static_cast<__u32>(out.index * kOffset);
        }
        return 0;
      }
      case VIDIOC_QBUF:
        queued_.push_back(static_cast<v4l2_buffer*>(argument)->index);
        return 0;
      case VIDIOC_DQBUF:
        return dequeue(*static_cast<v4l2_buffer*>(argument));
      case VIDIOC_STREAMON:
        streaming_ = true;
        sequence_ = first_sequence;
        started_ = Clock::now();
        return 0;
      case VIDIOC_STREAMOFF:
        streaming_ = false;
        queued_.clear();
        return 0;
      case VIDIOC_QUERYCTRL: {
        auto& out = *static_cast<v4l2_queryctrl*>(argument);
        const auto range = control_ranges.find(out.id);
        if (range == control_ranges.end()) return failWith(EINVAL);
        out.minimum = range->second.first;
        out.maximum = range->second.second;
        return 0;
      }
      case VIDIOC_S_CTRL: {
        const auto& in = *static_cast<v4l2_control*>(argument);
        if (!control_ranges.contains(in.id)) return failWith(EINVAL);
        controls[in.id] = in.value;
        return 0;
      }
      case VIDIOC_G_CTRL: {
        auto& out = *static_cast<v4l2_control*>(argument);
        out.value = controls[out.id];
        return 0;
      }
      default:
        return failWith(ENOTTY);
    }
  }

 private:
  static constexpr int kFd = 1'000'000;  // no descriptor of this process
  static constexpr std::size_t kOffset = 1 << 24;

  static int failWith(int error) {
    errno = error;
    return -1;
  }
  [[nodiscard]] __u32 rowBytes() const {
    if (fourcc_ == V4L2_PIX_FMT_MJPEG) return 0;
    return fourcc_ == V4L2_PIX_FMT_YUYV || fourcc_ == V4L2_PIX_FMT_SRGGB10 ? 2 * width_ + 16 : width_ + 16;
  }
  [[nodiscard]] std::size_t sizeOfImage() const {
    if (fourcc_ == V4L2_PIX_FMT_MJPEG) return 4096;
    return std::size_t{rowBytes()} * height_ * (fourcc_ == V4L2_PIX_FMT_NV12 ? 3 : 2) / 2;
  }
  void get(v4l2_format& format) const {
    if (planes) {
      format.fmt.pix_mp.pixelformat = fourcc_;
      format.fmt.pix_mp.width = width_;
      format.fmt.pix_mp.height = height_;
      format.fmt.pix_mp.num_planes = 1;
      format.fmt.pix_mp.plane_fmt[0] = {static_cast<__u32>(sizeOfImage()), rowBytes(), {}};
    } else {
      format.fmt.pix.pixelformat = fourcc_;
      format.fmt.pix.width = width_;
      format.fmt.pix.height = height_;
      format.fmt.pix.bytesperline = rowBytes();
      format.fmt.pix.sizeimage = static_cast<__u32>(sizeOfImage());
    }
  }
  void set(v4l2_format& format) {
    fourcc_ = planes ? format.fmt.pix_mp.pixelformat : format.fmt.pix.pixelformat;
    width_ = planes ? format.fmt.pix_mp.width : format.fmt.pix.width;
    height_ = planes ? format.fmt.pix_mp.height : format.fmt.pix.height;
    get(format);
  }
  // Frames of which nothing is left because no buffer was free when they were taken count as dropped.
  [[nodiscard]] bool due() const {
    return streaming_ && !queued_.empty() && Clock::now() >= started_ + interval;
  }
  int dequeue(v4l2_buffer& out) {
    if (!streaming_) return failWith(EINVAL);
    if (!due()) return failWith(EAGAIN);
    started_ += interval;
    out.index = queued_.front();
    queued_.erase(queued_.begin());
    std::vector<std::uint8_t>& memory = memory_[out.index];
    std::fill(memory.begin(), memory.end(), static_cast<std::uint8_t>(sequence_ + 1));
    (planes ? out.m.planes[0].bytesused : out.bytesused) = static_cast<__u32>(memory.size());
    out.sequence = sequence_++;
    out.flags = (stamps ? V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC : 0) |
                (at_start ? V4L2_BUF_FLAG_TSTAMP_SRC_SOE : V4L2_BUF_FLAG_TSTAMP_SRC_EOF);
    if (damage_) out.flags |= V4L2_BUF_FLAG_ERROR;
    damage_ = false;
    const auto stamp = std::chrono::duration_cast<std::chrono::microseconds>(started_.time_since_epoch());
    out.timestamp = {stamp.count() / 1'000'000, stamp.count() % 1'000'000};
    return 0;
  }

  std::mutex mutex_;
  bool plugged_ = true, alive_ = false, streaming_ = false, damage_ = false;
  std::uint32_t fourcc_ = V4L2_PIX_FMT_GREY;
  __u32 width_ = 64, height_ = 48;
  std::vector<std::vector<std::uint8_t>> memory_;
  std::vector<std::uint32_t> queued_;
  std::uint32_t sequence_ = 0;
  Clock::time_point started_;
};

}  // namespace overfly::capture::v4l2
