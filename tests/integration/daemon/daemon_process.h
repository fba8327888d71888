#pragma once
#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/shell.h"

// The built daemon as a process of its own, with a folder of its own, talked to over HTTP and by signals.
namespace overfly::test {

namespace fs = std::filesystem;

// The recorded flight of nine small frames; empty when it is not on this machine.
[[nodiscard]] fs::path smokeFlight();

class DaemonProcess {
 public:
  // A new folder with overfly.toml: the smoke flight at `speed`, and what `settings` says beside it (TOML,
  // whole sections other than source, map and link).
  explicit DaemonProcess(double speed = 0, const std::string& settings = {});
  ~DaemonProcess();  // killed when it still runs; the folder is removed
  DaemonProcess(const DaemonProcess&) = delete;
  DaemonProcess& operator=(const DaemonProcess&) = delete;

  // Starts it (again). `environment`: "NAME=value".
  void start(const std::vector<std::string>& arguments = {},
             const std::vector<std::string>& environment = {});
  void send(int signal) const;
  [[nodiscard]] pid_t pid() const { return pid_; }
  // The exit status, or 128 + signal; nullopt: it still ran after `limit`.
  std::optional<int> wait(std::chrono::seconds limit);

  [[nodiscard]] std::string url() const;        // waits until it is printed
  [[nodiscard]] nlohmann::json status() const;  // null when nothing answers
  // Until `condition` holds of the status; false: not within `limit`.
  bool waitFor(const std::function<bool(const nlohmann::json&)>& condition, std::chrono::seconds limit) const;
  // Until everything is mapped.
  bool waitUntilMapped(std::chrono::seconds limit) const;

  [[nodiscard]] std::string log() const;  // stdout and stderr since the first start
  [[nodiscard]] fs::path missions() const { return folder_ / "missions"; }
  [[nodiscard]] std::vector<std::string> missionNames() const;
  [[nodiscard]] fs::path settingsFile() const { return folder_ / "overfly.toml"; }
  [[nodiscard]] fs::path folder() const { return folder_; }

 private:
  fs::path folder_;
  pid_t pid_ = -1;
};

}  // namespace overfly::test
