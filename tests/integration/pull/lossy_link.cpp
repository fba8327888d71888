#include "tests/integration/pull/lossy_link.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <deque>
#include <utility>
#include <vector>

namespace overfly::test {
namespace {

using Clock = std::chrono::steady_clock;

bool bringUp(int socket, const char* device, const std::string& address) {
  ifreq request{};
  std::strncpy(request.ifr_name, device, IFNAMSIZ - 1);
  auto& in = reinterpret_cast<sockaddr_in&>(request.ifr_addr);
  if (!address.empty()) {
    in.sin_family = AF_INET;
    inet_pton(AF_INET, address.c_str(), &in.sin_addr);
    if (ioctl(socket, SIOCSIFADDR, &request) != 0) return false;
    inet_pton(AF_INET, "255.255.255.0", &in.sin_addr);
    if (ioctl(socket, SIOCSIFNETMASK, &request) != 0) return false;
  }
  if (ioctl(socket, SIOCGIFFLAGS, &request) != 0) return false;
  request.ifr_flags = static_cast<short>(request.ifr_flags | IFF_UP | IFF_RUNNING);
  return ioctl(socket, SIOCSIFFLAGS, &request) == 0;
}

// On a thread that has left the others' namespace.
bool setUp(const std::string& address, int& netns, int& device) {
  if (unshare(CLONE_NEWNET) != 0) return false;
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  device = open("/dev/net/tun", O_RDWR | O_CLOEXEC | O_NONBLOCK);
  netns = open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC);
  ifreq request{};
  std::strncpy(request.ifr_name, "radio", IFNAMSIZ - 1);
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  const bool done = socket >= 0 && device >= 0 && netns >= 0 && ioctl(device, TUNSETIFF, &request) == 0 &&
                    bringUp(socket, "lo", "") && bringUp(socket, "radio", address);
  if (socket >= 0) close(socket);
  return done;
}

}  // namespace

std::optional<Namespace> Namespace::make(const std::string& address) {
  int netns = -1, device = -1;
  bool done = false;
  std::thread([&] { done = setUp(address, netns, device); }).join();
  Namespace out(netns, device);
  if (!done) return std::nullopt;
  return out;
}

Namespace::Namespace(Namespace&& other) noexcept
    : netns_(std::exchange(other.netns_, -1)), device_(std::exchange(other.device_, -1)) {}

Namespace::~Namespace() {
  if (device_ >= 0) close(device_);
  if (netns_ >= 0) close(netns_);
}

void Namespace::run(const std::function<void()>& work) const {
  std::thread([&] {
    if (setns(netns_, CLONE_NEWNET) == 0) work();
  }).join();
}

LossyLink::LossyLink(const Namespace& drone, const Namespace& ground, const LinkQuality& quality)
    : quality_(quality) {
  down_ = std::jthread([this, from = drone.device(), to = ground.device()](const std::stop_token& stop) {
    carry(stop, from, to, quality_.seed, to_ground_);
  });
  up_ = std::jthread([this, from = ground.device(), to = drone.device()](const std::stop_token& stop) {
    carry(stop, from, to, quality_.seed + 1, to_drone_);
  });
}

void LossyLink::carry(const std::stop_token& stop, int from, int to, std::uint64_t seed,
                      std::atomic<std::uint64_t>& bytes) {
  struct Packet {
    Clock::time_point due;
    std::vector<char> data;
  };
  std::deque<Packet> flying;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> share;
  const auto seconds = [](double s) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
  };
  auto free_at = Clock::now();  // when the radio has sent what it holds
  std::vector<char> buffer(65536);
  while (!stop.stop_requested()) {
    const auto now = Clock::now();
    while (!flying.empty() && flying.front().due <= now) {
      const auto& data = flying.front().data;
      if (dark_)
        ++lost_;
      else if (write(to, data.data(), data.size()) > 0)
        bytes += data.size();
      flying.pop_front();
    }
    int wait_ms = 50;
    if (!flying.empty())
      wait_ms = static_cast<int>(
                    std::chrono::duration_cast<std::chrono::milliseconds>(flying.front().due - now).count()) +
                1;
    pollfd ready{from, POLLIN, 0};
    if (poll(&ready, 1, std::min(wait_ms, 50)) <= 0) continue;
    const auto size = read(from, buffer.data(), buffer.size());
    if (size <= 0) continue;
    const auto arrived = Clock::now();
    free_at = std::max(free_at, arrived);
    const bool queue_full = free_at - arrived > seconds(quality_.queue_s);
    if (dark_ || queue_full || share(random) < quality_.loss) {
      ++lost_;
      continue;
    }
    free_at += seconds(static_cast<double>(size) * 8 / quality_.bits_per_s);
    flying.push_back({free_at + seconds(quality_.delay_s), {buffer.begin(), buffer.begin() + size}});
  }
}

}  // namespace overfly::test
