#include "capture/v4l2/kernel.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>

namespace overfly::capture::v4l2 {
namespace {

class SystemKernel final : public Kernel {
 public:
  int open(const char* path) override { return ::open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC); }
  int close(int fd) override { return ::close(fd); }
  int ioctl(int fd, unsigned long request, void* argument) override {
    int result = 0;
    do {
      result = ::ioctl(fd, request, argument);
    } while (result == -1 && errno == EINTR);
    return result;
  }
  void* map(int fd, std::size_t length, std::size_t offset) override {
    return ::mmap(nullptr, length, PROT_READ | PROT_WRITE, MAP_SHARED, fd, static_cast<off_t>(offset));
  }
  int unmap(void* address, std::size_t length) override { return ::munmap(address, length); }
  int poll(pollfd* fds, unsigned count, int timeout_ms) override { return ::poll(fds, count, timeout_ms); }
};

}  // namespace

std::shared_ptr<Kernel> systemKernel() { return std::make_shared<SystemKernel>(); }

}  // namespace overfly::capture::v4l2
