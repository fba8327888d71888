#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <string_view>

#include "daemon/cli/check.h"

namespace overfly::cli {
namespace {

using State = Check::State;

speed_t speedOf(int baud) {
  static constexpr std::pair<int, speed_t> kSpeeds[] = {
      {9600, B9600},     {19200, B19200},   {38400, B38400},   {57600, B57600},    {115200, B115200},
      {230400, B230400}, {460800, B460800}, {921600, B921600}, {1500000, B1500000}};
  for (const auto& [rate, code] : kSpeeds)
    if (rate == baud) return code;
  return B57600;
}

int openSerial(const std::string& device, int baud) {
  const int fd = open(device.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  termios line{};
  if (fd >= 0 && tcgetattr(fd, &line) == 0) {
    cfmakeraw(&line);
    cfsetspeed(&line, speedOf(baud));
    tcsetattr(fd, TCSANOW, &line);
  }
  return fd;
}

int openSocket(const std::string& host, const std::string& port, bool tcp) {
  addrinfo wanted{};
  wanted.ai_socktype = tcp ? SOCK_STREAM : SOCK_DGRAM;
  wanted.ai_flags = tcp ? 0 : AI_PASSIVE;
  addrinfo* found = nullptr;
  if (getaddrinfo(host.empty() ? nullptr : host.c_str(), port.c_str(), &wanted, &found) != 0) {
    errno = EHOSTUNREACH;
    return -1;
  }
  const int fd = socket(found->ai_family, found->ai_socktype | SOCK_CLOEXEC, 0);
  const int code =
      tcp ? connect(fd, found->ai_addr, found->ai_addrlen) : bind(fd, found->ai_addr, found->ai_addrlen);
  const int error = errno;
  freeaddrinfo(found);
  if (code == 0) return fd;
  close(fd);
  errno = error;
  return -1;
}

// "udp:[ADDRESS:]PORT", "tcp:HOST:PORT", "serial:DEVICE[:BAUD]".
int openLink(std::string_view text) {
  const auto kind = text.substr(0, text.find(':'));
  const std::string rest(text.substr(kind.size() + 1));
  const auto colon = rest.rfind(':');
  const auto head = colon == std::string::npos ? std::string() : rest.substr(0, colon);
  const auto tail = colon == std::string::npos ? rest : rest.substr(colon + 1);
  if (kind == "serial")
    return head.empty() ? openSerial(rest, 57600) : openSerial(head, std::atoi(tail.c_str()));
  return openSocket(head, tail, kind == "tcp");
}

}  // namespace

Check checkAutopilot(const config::Settings& settings, double seconds) {
  Check out;
  out.name = "autopilot";
  const auto& link = settings.pose.mavlink;
  out.add("link", link);
  if (link.empty()) {
    out.finding = "none set (pose.mavlink); poses come with the source";
    return out;
  }
  const int fd = openLink(link);
  if (fd < 0 && errno == EADDRINUSE) {
    out.finding = link + " is in use, by overflyd most likely; see its status";
    return out;
  }
  if (fd < 0) {
    out.worse(State::Problem, link + " cannot be opened: " + std::strerror(errno),
              "check the cable, the device's name and its group (dialout)");
    return out;
  }
  // Frames of MAVLink 1 and 2 begin with these bytes.
  constexpr unsigned char kV1 = 0xfe, kV2 = 0xfd;
  using Clock = std::chrono::steady_clock;
  const auto until =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  std::size_t bytes = 0, heads = 0;
  while (Clock::now() < until && heads < 3) {
    pollfd ready{fd, POLLIN, 0};
    if (poll(&ready, 1, 100) <= 0) continue;
    std::array<unsigned char, 2048> block{};
    const auto size = read(fd, block.data(), block.size());
    if (size <= 0) break;
    bytes += static_cast<std::size_t>(size);
    heads += static_cast<std::size_t>(std::count_if(block.begin(), block.begin() + size,
                                                    [](unsigned char c) { return c == kV1 || c == kV2; }));
  }
  close(fd);
  out.add("bytes", bytes);
  out.finding = "heard on " + link;
  if (bytes == 0)
    out.worse(State::Warning, fmt::format("silent on {} for {:.0f} s", link, seconds),
              "see that the autopilot sends MAVLink to that port; it may come later");
  else if (heads == 0)
    out.worse(State::Warning, "what comes on " + link + " is not MAVLink",
              "check the baud rate, and the autopilot's protocol");
  return out;
}

}  // namespace overfly::cli
