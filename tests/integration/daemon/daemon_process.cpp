#include "tests/integration/daemon/daemon_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <regex>
#include <thread>

#include "tests/integration/link/client.h"

namespace overfly::test {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

fs::path smokeFlight() {
  const fs::path path = fs::path(OVERFLY_FLIGHTS_DIR) / "brighton-beach-smoke";
  return fs::exists(path) ? path : fs::path();
}

DaemonProcess::DaemonProcess(double speed, const std::string& settings) {
  std::string name = (fs::temp_directory_path() / "overfly_daemon_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
  folder_ = name;
  std::ofstream(settingsFile()) << fmt::format(
      "[source]\nkind = \"replay\"\npath = \"{}\"\nspeed = {}\n[map]\nfolder = \"{}\"\n"
      "[link]\nport = 0\n[record]\nmin_free_mb = 0\n[store]\nmin_free_mb = 0\n{}\n",
      smokeFlight().string(), speed, missions().string(), settings);
}

DaemonProcess::~DaemonProcess() {
  if (pid_ > 0) {
    send(SIGKILL);
    (void)wait(10s);
  }
  std::error_code code;
  fs::remove_all(folder_, code);
}

void DaemonProcess::start(const std::vector<std::string>& arguments,
                          const std::vector<std::string>& environment) {
  std::vector<std::string> words{OVERFLYD, "--config", settingsFile().string()};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  // Only what it prints from now on says where it listens.
  if (fs::exists(folder_ / "log")) {
    std::ofstream(folder_ / "earlier", std::ios::app) << std::ifstream(folder_ / "log").rdbuf();
    fs::remove(folder_ / "log");
  }
  pid_ = fork();
  if (pid_ == 0) {
    const int fd = open((folder_ / "log").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
    dup2(fd, STDOUT_FILENO);
    dup2(fd, STDERR_FILENO);
    for (const std::string& variable : environment) {
      const auto equals = variable.find('=');
      setenv(variable.substr(0, equals).c_str(), variable.substr(equals + 1).c_str(), 1);
    }
    execv(argv[0], argv.data());
    _exit(127);
  }
}

void DaemonProcess::send(int signal) const { kill(pid_, signal); }

std::optional<int> DaemonProcess::wait(std::chrono::seconds limit) {
  for (const auto until = Clock::now() + limit; Clock::now() < until; std::this_thread::sleep_for(5ms)) {
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) != pid_) continue;
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  return std::nullopt;
}

std::string DaemonProcess::url() const {
  static const std::regex kUrl("(http://[^\\s]+)/\\n");
  for (int i = 0; i < 3000; ++i) {
    std::ifstream in(folder_ / "log");
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    std::smatch match;
    if (std::regex_search(text, match, kUrl)) return match[1];
    std::this_thread::sleep_for(20ms);
  }
  return {};
}

nlohmann::json DaemonProcess::status() const {
  return nlohmann::json::parse(fetch(url() + "/status").body, nullptr, false);
}

bool DaemonProcess::waitFor(const std::function<bool(const nlohmann::json&)>& condition,
                            std::chrono::seconds limit) const {
  for (const auto until = Clock::now() + limit; Clock::now() < until; std::this_thread::sleep_for(100ms))
    if (const auto now = status(); now.is_object() && condition(now)) return true;
  return false;
}

bool DaemonProcess::waitUntilMapped(std::chrono::seconds limit) const {
  return waitFor([](const nlohmann::json& s) { return s["source"]["ended"] == true && s["state"] == "idle"; },
                 limit);
}

std::string DaemonProcess::log() const {
  std::string text;
  for (const char* name : {"earlier", "log"}) {
    std::ifstream in(folder_ / name);
    text.append(std::istreambuf_iterator<char>(in), {});
  }
  return text;
}

std::vector<std::string> DaemonProcess::missionNames() const {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(missions()))
    if (!entry.path().filename().string().starts_with(".")) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace overfly::test
