#include "capture/pose/transport.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <map>
#include <optional>

#include "capture/record/files.h"

namespace overfly::capture {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kPeerSilence = std::chrono::seconds(5);
constexpr int kConnect_ms = 2000;

std::string reason(int code) { return std::strerror(code); }

std::optional<int> numberIn(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

// What all three share: one descriptor, waited for together with another one that wakes.
class Descriptor : public Transport {
 public:
  explicit Descriptor(std::string name) : name_(std::move(name)) {}
  [[nodiscard]] const std::string& name() const override { return name_; }
  void close() override { fd_ = FileDescriptor(); }

  Result<void> read(std::vector<std::uint8_t>& bytes, std::chrono::milliseconds timeout,
                    int wake_fd) override {
    std::array<pollfd, 2> waits{pollfd{fd_.get(), POLLIN, 0}, pollfd{wake_fd, POLLIN, 0}};
    const int ready = ::poll(waits.data(), wake_fd >= 0 ? 2 : 1, static_cast<int>(timeout.count()));
    if (ready < 0 && errno != EINTR) return gone(reason(errno));
    if (ready <= 0 || waits[0].revents == 0) return {};
    return take(bytes);
  }

 protected:
  // What is there, without waiting.
  virtual Result<void> take(std::vector<std::uint8_t>& bytes) {
    std::array<std::uint8_t, 4096> buffer{};
    const ssize_t count = ::read(fd_.get(), buffer.data(), buffer.size());
    if (count > 0) bytes.insert(bytes.end(), buffer.begin(), buffer.begin() + count);
    if (count == 0) return gone("the other side closed it");
    if (count < 0 && errno != EAGAIN && errno != EINTR) return gone(reason(errno));
    return {};
  }

  Result<void> write(std::span<const std::uint8_t> packet) override {
    const ssize_t count = ::write(fd_.get(), packet.data(), packet.size());
    if (count == static_cast<ssize_t>(packet.size())) return {};
    // A full queue: half a packet would only confuse, and the next one comes soon.
    if (count >= 0 || errno == EAGAIN || errno == EINTR) return {};
    return gone(reason(errno));
  }

  [[nodiscard]] tl::unexpected<Error> gone(const std::string& why) const {
    return fail(ErrorCode::Unavailable, fmt::format("{} is gone: {}", name_, why));
  }

  FileDescriptor fd_;

 private:
  std::string name_;
};

class Udp final : public Descriptor {
 public:
  Udp(std::string name, in_addr address, int port) : Descriptor(std::move(name)) {
    local_.sin_family = AF_INET;
    local_.sin_addr = address;
    local_.sin_port = htons(static_cast<std::uint16_t>(port));
  }

  Result<void> open() override {
    fd_ = FileDescriptor(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    if (!fd_) return fail(ErrorCode::Io, fmt::format("{}: no socket: {}", name(), reason(errno)));
    if (::bind(fd_.get(), reinterpret_cast<const sockaddr*>(&local_), sizeof local_) == 0) return {};
    const int code = errno;
    fd_ = FileDescriptor();
    if (code == EADDRINUSE) {
      return fail(
          ErrorCode::Io,
          fmt::format("{}: another program listens on this port; end it or set pose.mavlink to a port "
                      "that your MAVLink router sends to us alone",
                      name()));
    }
    if (code == EADDRNOTAVAIL)
      return fail(ErrorCode::Unavailable, fmt::format("{}: this machine has no such address (now)", name()));
    return fail(ErrorCode::Io, fmt::format("{}: cannot listen: {}", name(), reason(code)));
  }

  Result<void> take(std::vector<std::uint8_t>& bytes) override {
    std::array<std::uint8_t, 65536> buffer;
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t count =
        ::recvfrom(fd_.get(), buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
    if (count < 0) {
      // A refused answer (ICMP) is the peer's matter, not the socket's.
      if (errno == EAGAIN || errno == EINTR || errno == ECONNREFUSED) return {};
      return gone(reason(errno));
    }
    const auto now = Clock::now();
    const bool same =
        peer_ && peer_->sin_addr.s_addr == from.sin_addr.s_addr && peer_->sin_port == from.sin_port;
    if (peer_ && !same && now - heard_ < kPeerSilence) {
      ++strangers_;
      return {};
    }
    peer_ = from;
    heard_ = now;
    bytes.insert(bytes.end(), buffer.begin(), buffer.begin() + count);
    return {};
  }

  Result<void> write(std::span<const std::uint8_t> packet) override {
    if (!peer_) return {};
    const ssize_t count = ::sendto(fd_.get(), packet.data(), packet.size(), 0,
                                   reinterpret_cast<const sockaddr*>(&*peer_), sizeof *peer_);
    if (count >= 0 || errno == EAGAIN || errno == EINTR || errno == ECONNREFUSED || errno == ENETUNREACH ||
        errno == EHOSTUNREACH) {
      return {};
    }
    return gone(reason(errno));
  }

  [[nodiscard]] std::uint64_t strangers() const override { return strangers_; }

 private:
  sockaddr_in local_{};
  std::optional<sockaddr_in> peer_;
  Clock::time_point heard_{};
  std::uint64_t strangers_ = 0;
};

class Tcp final : public Descriptor {
 public:
  Tcp(std::string name, std::string host, std::string port)
      : Descriptor(std::move(name)), host_(std::move(host)), port_(std::move(port)) {}

  Result<void> open() override {
    fd_ = FileDescriptor();
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    if (const int code = ::getaddrinfo(host_.c_str(), port_.c_str(), &hints, &found); code != 0) {
      return fail(ErrorCode::Unavailable, fmt::format("{}: {}: {}", name(), host_, ::gai_strerror(code)));
    }
    const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> list(found, ::freeaddrinfo);
    int code = 0;
    for (const addrinfo* one = list.get(); one != nullptr; one = one->ai_next) {
      FileDescriptor fd(::socket(one->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
      if (!fd) continue;
      code = ::connect(fd.get(), one->ai_addr, one->ai_addrlen) == 0 ? 0 : errno;
      if (code == EINPROGRESS) {
        pollfd wait{fd.get(), POLLOUT, 0};
        code = ETIMEDOUT;
        socklen_t size = sizeof code;
        if (::poll(&wait, 1, kConnect_ms) == 1) ::getsockopt(fd.get(), SOL_SOCKET, SO_ERROR, &code, &size);
      }
      if (code != 0) continue;
      const int on = 1;
      ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      ::setsockopt(fd.get(), SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
      fd_ = std::move(fd);
      return {};
    }
    return fail(ErrorCode::Unavailable, fmt::format("{}: cannot connect: {}", name(), reason(code)));
  }

  Result<void> write(std::span<const std::uint8_t> packet) override {
    const ssize_t count = ::send(fd_.get(), packet.data(), packet.size(), MSG_NOSIGNAL);
    if (count >= 0 || errno == EAGAIN || errno == EINTR) return {};
    return gone(reason(errno));
  }

 private:
  std::string host_, port_;
};

const std::map<int, speed_t>& speeds() {
  static const std::map<int, speed_t> kSpeeds{
      {9600, B9600},       {19200, B19200},     {38400, B38400},    {57600, B57600},   {115200, B115200},
      {230400, B230400},   {460800, B460800},   {500000, B500000},  {921600, B921600}, {1000000, B1000000},
      {1500000, B1500000}, {2000000, B2000000}, {3000000, B3000000}};
  return kSpeeds;
}

class Serial final : public Descriptor {
 public:
  Serial(std::string name, std::string device, speed_t speed)
      : Descriptor(std::move(name)), device_(std::move(device)), speed_(speed) {}

  Result<void> open() override {
    fd_ = FileDescriptor();
    FileDescriptor fd(::open(device_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (!fd) {
      const int code = errno;
      if (code == EACCES) {
        return fail(ErrorCode::Io,
                    fmt::format("{}: permission denied; add the service's user to the group that owns {} "
                                "(dialout on Debian)",
                                name(), device_));
      }
      if (code == EBUSY) return inUse();
      return fail(ErrorCode::Unavailable, fmt::format("{}: {}", name(), reason(code)));
    }
    // Both ways by which well-behaved programs keep a line to themselves.
    if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) return inUse();
    termios settings{};
    if (::tcgetattr(fd.get(), &settings) != 0)
      return fail(ErrorCode::Io, fmt::format("{}: {} is no serial line", name(), device_));
    ::ioctl(fd.get(), TIOCEXCL);
    ::cfmakeraw(&settings);
    settings.c_cflag |= CLOCAL | CREAD;
    settings.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | CSTOPB | PARENB);
    ::cfsetspeed(&settings, speed_);
    if (::tcsetattr(fd.get(), TCSANOW, &settings) != 0)
      return fail(ErrorCode::Io,
                  fmt::format("{}: the line does not take this speed: {}", name(), reason(errno)));
    ::tcflush(fd.get(), TCIOFLUSH);
    fd_ = std::move(fd);
    return {};
  }

 private:
  [[nodiscard]] tl::unexpected<Error> inUse() const {
    return fail(ErrorCode::Io,
                fmt::format("{}: another program has {} open; end it (mavlink-router, gpsd, ModemManager?)",
                            name(), device_));
  }

  std::string device_;
  speed_t speed_;
};

tl::unexpected<Error> bad(std::string_view text, const std::string& why) {
  return fail(ErrorCode::BadSettings, fmt::format("pose.mavlink: \"{}\": {}", text, why));
}

}  // namespace

Result<std::unique_ptr<Transport>> makeTransport(std::string_view text) {
  const std::string name(text);
  const std::size_t colon = text.find(':');
  const std::string_view kind = text.substr(0, colon);
  const std::string rest(colon == std::string_view::npos ? "" : text.substr(colon + 1));
  const std::size_t last = rest.rfind(':');
  const std::string tail = last == std::string::npos ? rest : rest.substr(last + 1);
  const std::string head = last == std::string::npos ? "" : rest.substr(0, last);
  const auto port = numberIn(tail);
  if (kind == "udp") {
    if (!port || *port < 1 || *port > 65535) return bad(text, "a port is a number from 1 to 65535");
    in_addr address{INADDR_ANY};
    if (!head.empty() && ::inet_pton(AF_INET, head.c_str(), &address) != 1)
      return bad(text, "the address to listen on must be one of this machine's, as in udp:127.0.0.1:14550");
    return std::make_unique<Udp>(name, address, *port);
  }
  if (kind == "tcp") {
    if (!port || *port < 1 || *port > 65535 || head.empty()) return bad(text, "write tcp:HOST:PORT");
    return std::make_unique<Tcp>(name, head, tail);
  }
  if (kind == "serial") {
    const bool has_speed = !head.empty() && port.has_value();
    const auto speed = speeds().find(has_speed ? *port : 57600);
    if (speed == speeds().end())
      return bad(text, "not a speed that serial lines have; try 57600, 115200 or 921600");
    const std::string device = has_speed ? head : rest;
    if (device.empty()) return bad(text, "write serial:DEVICE[:BAUD]");
    return std::make_unique<Serial>(name, device, speed->second);
  }
  return bad(text, "write udp:[ADDRESS:]PORT, tcp:HOST:PORT or serial:DEVICE[:BAUD]");
}

}  // namespace overfly::capture
