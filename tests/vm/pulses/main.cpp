#include <time.h>

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <thread>

// The shutter of the guest's camera: pulses on a line of gpio-sim, in step with the frames that the kernel
// says it hands out (trace event v4l2:v4l2_dqbuf), and a record of both.
//   pulses PULL_FILE RECORD INTERVAL_MS LAG_MS SECONDS
// Each frame's stamp lags LAG_MS behind its pulse. One pulse in 20 is left out and one in 20 is followed by a
// spurious one. RECORD: lines "frame SEQUENCE STAMP_NS TOLD_NS" (when it was handed out, as far as the trace
// is read at once), "pulse NUMBER SET_NS", "missed NUMBER", "spurious SET_NS"; CLOCK_MONOTONIC, the moment
// before the line was set.
namespace {

std::int64_t now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

void sleepUntil(std::int64_t time_ns) {
  const timespec t{time_ns / 1'000'000'000, time_ns % 1'000'000'000};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

std::optional<std::int64_t> field(const std::string& line, const std::string& name) {
  const std::size_t at = line.find(name + " = ");
  if (at == std::string::npos) return std::nullopt;
  return std::atoll(line.c_str() + at + name.size() + 3);
}

class Record {
 public:
  explicit Record(const char* path) : out_(path) {}
  void write(const std::string& line) {
    const std::scoped_lock lock(mutex_);
    out_ << line << std::endl;
  }

 private:
  std::mutex mutex_;
  std::ofstream out_;
};

// One pulse of a millisecond; when it was set.
std::int64_t pulse(const char* pull_file) {
  std::ofstream pull(pull_file);
  const std::int64_t set = now();
  pull << "pull-up" << std::flush;
  sleepUntil(set + 1'000'000);
  std::ofstream(pull_file) << "pull-down" << std::flush;
  return set;
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 6) {
    std::fprintf(stderr, "pulses PULL_FILE RECORD INTERVAL_MS LAG_MS SECONDS\n");
    return 2;
  }
  const char* pull_file = arguments[1];
  const std::int64_t interval = std::atoll(arguments[3]) * 1'000'000,
                     lag = std::atoll(arguments[4]) * 1'000'000;
  const std::int64_t pulses = std::atoll(arguments[5]) * 1'000'000'000 / interval;
  Record record(arguments[2]);
  std::atomic<std::int64_t> newest{0};  // stamp
  std::thread frames([&] {
    std::ifstream trace("/sys/kernel/tracing/trace_pipe");
    for (std::string line; std::getline(trace, line);) {
      const auto stamp = field(line, "timestamp"), sequence = field(line, "sequence");
      if (!stamp || !sequence) continue;
      record.write("frame " + std::to_string(*sequence) + " " + std::to_string(*stamp) + " " +
                   std::to_string(now()));
      newest = *stamp;
    }
  });
  frames.detach();
  while (newest == 0) sleepUntil(now() + 10'000'000);
  std::int64_t due = 0;
  std::mt19937 random(1);  // NOLINT: the same each time
  for (std::int64_t number = 0; number < pulses; ++number) {
    due += interval;
    // In step with the frames, also where their driver has fallen out of it.
    const std::int64_t phase = newest - lag;
    const std::int64_t off = (due - phase) - (due - phase + interval / 2) / interval * interval;
    if (due < now() || std::abs(off) > interval / 4) {
      due = phase;
      while (due < now() + interval / 2) due += interval;
    }
    sleepUntil(due);
    if (random() % 20 == 0) {
      record.write("missed " + std::to_string(number));
      continue;
    }
    record.write("pulse " + std::to_string(number) + " " + std::to_string(pulse(pull_file)));
    if (random() % 20 == 0) {
      sleepUntil(due + interval / 10 + static_cast<std::int64_t>(random() % 7) * interval / 10);
      record.write("spurious " + std::to_string(pulse(pull_file)));
    }
  }
  std::_Exit(0);
}
