#pragma once
#include <cstddef>
#include <memory>

struct pollfd;

namespace overfly::capture::v4l2 {

// The system calls that a V4L2 camera takes, so that a test can stand in for the kernel where there is no
// camera. Each returns what the call returns, with errno set. Methods may be called from any thread.
class Kernel {
 public:
  virtual ~Kernel() = default;
  Kernel() = default;
  Kernel(const Kernel&) = delete;
  Kernel& operator=(const Kernel&) = delete;

  virtual int open(const char* path) = 0;  // read and write, not blocking, closed on exec
  virtual int close(int fd) = 0;
  virtual int ioctl(int fd, unsigned long request, void* argument) = 0;   // again after EINTR
  virtual void* map(int fd, std::size_t length, std::size_t offset) = 0;  // MAP_FAILED on failure
  virtual int unmap(void* address, std::size_t length) = 0;
  virtual int poll(pollfd* fds, unsigned count, int timeout_ms) = 0;
};

// The real one.
[[nodiscard]] std::shared_ptr<Kernel> systemKernel();

}  // namespace overfly::capture::v4l2
