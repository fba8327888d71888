#pragma once
#include <memory>
#include <string>
#include <utility>

#include "capture/v4l2/kernel.h"
#include "config/error.h"

namespace overfly::capture::v4l2 {

inline constexpr int kNodes = 64;  // /dev/video0 to /dev/video63 are looked at

// An open device node. Move-only; closes. Thread-bound.
class Node {
 public:
  // Unavailable: no such device, in use, or its driver is going; Io: not permitted (says which group would
  // be); Unsupported: no camera. The message names the path and what to do.
  [[nodiscard]] static Result<Node> open(std::shared_ptr<Kernel> kernel, const std::string& path);
  // The first device that can take pictures. Unavailable: there is none.
  [[nodiscard]] static Result<Node> openFirst(const std::shared_ptr<Kernel>& kernel);

  Node(Node&& other) noexcept { *this = std::move(other); }
  Node& operator=(Node&& other) noexcept {
    std::swap(kernel_, other.kernel_);
    std::swap(path_, other.path_);
    std::swap(card_, other.card_);
    std::swap(driver_, other.driver_);
    std::swap(fd_, other.fd_);
    std::swap(planes_, other.planes_);
    return *this;
  }
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
  ~Node() {
    if (fd_ >= 0) kernel_->close(fd_);
  }

  // 0, or the errno.
  template <typename T>
  [[nodiscard]] int call(unsigned long request, T& argument) const {
    return kernel_->ioctl(fd_, request, &argument) == 0 ? 0 : lastError();
  }
  // What a failed call means to a person, `doing` said in words ("start streaming").
  [[nodiscard]] tl::unexpected<Error> failed(const std::string& doing, int error) const;

  [[nodiscard]] Kernel& kernel() const { return *kernel_; }
  [[nodiscard]] int fd() const { return fd_; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const std::string& card() const { return card_; }
  [[nodiscard]] const std::string& driver() const { return driver_; }
  [[nodiscard]] bool planes() const { return planes_; }  // speaks the multi-planar API only

 private:
  Node(std::shared_ptr<Kernel> kernel, std::string path, int fd)
      : kernel_(std::move(kernel)), path_(std::move(path)), fd_(fd) {}
  [[nodiscard]] static int lastError();

  std::shared_ptr<Kernel> kernel_;
  std::string path_, card_, driver_;
  int fd_ = -1;
  bool planes_ = false;
};

}  // namespace overfly::capture::v4l2
