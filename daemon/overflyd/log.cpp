#include "daemon/overflyd/log.h"

#include <fmt/format.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <map>
#include <memory>
#include <mutex>

namespace overfly::daemon {
namespace {

// sd-daemon(3): "<" priority ">" before a line.
class JournalLevel final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& out) override {
    const char* prefix = "<6>";
    switch (message.level) {
      case spdlog::level::trace:
      case spdlog::level::debug:
        prefix = "<7>";
        break;
      case spdlog::level::warn:
        prefix = "<4>";
        break;
      case spdlog::level::err:
        prefix = "<3>";
        break;
      case spdlog::level::critical:
        prefix = "<2>";
        break;
      default:
        break;
    }
    out.append(prefix, prefix + 3);
  }
  [[nodiscard]] std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<JournalLevel>();
  }
};

// systemd.exec(5): JOURNAL_STREAM names the device and inode of the journal's pipe.
bool stderrIsTheJournal() {
  const char* named = std::getenv("JOURNAL_STREAM");
  struct stat here {};
  return named != nullptr && fstat(STDERR_FILENO, &here) == 0 &&
         fmt::format("{}:{}", here.st_dev, here.st_ino) == named;
}

spdlog::level::level_enum levelOf(config::LogLevel level) {
  switch (level) {
    case config::LogLevel::Trace:
      return spdlog::level::trace;
    case config::LogLevel::Debug:
      return spdlog::level::debug;
    case config::LogLevel::Info:
      return spdlog::level::info;
    case config::LogLevel::Warning:
      return spdlog::level::warn;
    case config::LogLevel::Error:
      return spdlog::level::err;
  }
  return spdlog::level::info;
}

}  // namespace

void startLog(config::LogLevel level) {
  spdlog::set_default_logger(spdlog::stderr_logger_mt("overflyd"));
  if (stderrIsTheJournal()) {
    auto formatter = std::make_unique<spdlog::pattern_formatter>();
    formatter->add_flag<JournalLevel>('*').set_pattern("%*%v");
    spdlog::set_formatter(std::move(formatter));
  } else {
    spdlog::set_pattern("%l: %v");
  }
  setLogLevel(level);
}

void setLogLevel(config::LogLevel level) { spdlog::set_level(levelOf(level)); }

void warnOnce(const std::string& kind, const std::string& message) {
  struct Last {
    std::chrono::steady_clock::time_point time;
    std::uint64_t untold = 0;
  };
  static std::mutex mutex;
  static std::map<std::string, Last> known;
  const auto now = std::chrono::steady_clock::now();
  std::uint64_t untold = 0;
  {
    const std::scoped_lock lock(mutex);
    const auto [it, fresh] = known.try_emplace(kind, Last{now, 0});
    if (!fresh && now - it->second.time < std::chrono::minutes(1)) {
      ++it->second.untold;
      return;
    }
    untold = it->second.untold;
    it->second = {now, 0};
  }
  if (untold == 0)
    spdlog::warn("{}", message);
  else
    spdlog::warn("{} ({} more of this kind before it)", message, untold);
}

}  // namespace overfly::daemon
