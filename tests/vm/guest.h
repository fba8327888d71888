#pragma once
#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>

namespace overfly::vm {

// A Debian machine with systemd and cameras of the kernel's own, emulated by QEMU (tests/vm/image makes it).
// The build folder lies read-only under /mnt/host. Thread-bound; a guest that still runs is switched off.
class Guest {
 public:
  struct Ran {
    int status = -1;     // of the script; -1: the guest did not answer in time
    std::string output;  // stdout and stderr
  };

  // Why no guest can run here, in one sentence; empty when one can. Where the
  // cache has no image the first call makes it if OVERFLY_VM_BUILD_SECONDS allows it so long (default 0).
  [[nodiscard]] static std::string whyNot();

  // `disk`: keeps what the guest writes, so that it outlives a power-off; made of `disk_bytes` when it is
  // not there. Empty: in memory. Throws std::runtime_error with the console's last lines when the guest does
  // not come up.
  explicit Guest(std::filesystem::path disk = {}, std::uint64_t disk_bytes = 2ULL << 30);
  ~Guest();
  Guest(const Guest&) = delete;
  Guest& operator=(const Guest&) = delete;

  // Runs a bash script as root.
  Ran run(const std::string& script, std::chrono::seconds limit = std::chrono::seconds(120));
  // Runs it again until it ends with 0, or the time is over; the last outcome.
  Ran runUntilGood(const std::string& script, std::chrono::seconds limit);

  // The plug is pulled: nothing is written or ended first.
  void powerOff();

  // Ports of this machine that lead to the guest's link (TCP 8420) and autopilot port (UDP 14550).
  [[nodiscard]] int linkPort() const { return link_port_; }
  [[nodiscard]] int mavlinkPort() const { return mavlink_port_; }
  [[nodiscard]] std::string console() const;  // the last lines

 private:
  void start(const std::filesystem::path& disk, std::uint64_t disk_bytes);
  void connectAgent();
  [[nodiscard]] std::string readLine(std::chrono::steady_clock::time_point until);

  std::filesystem::path folder_;
  pid_t qemu_ = -1;
  int agent_ = -1;
  int link_port_ = 0, mavlink_port_ = 0;
  int number_ = 0;
  std::string received_;
};

}  // namespace overfly::vm
