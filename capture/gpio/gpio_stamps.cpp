#include "capture/gpio/gpio_stamps.h"

#include <algorithm>
#include <condition_variable>

#include "capture/gpio/detail/gpio_errors.h"

namespace overfly::capture {
namespace {

constexpr std::chrono::milliseconds kWait{20};

// False when asked to stop.
template <class Duration>
bool pause(const std::stop_token& stop, Duration time) {
  std::mutex mutex;
  std::unique_lock lock(mutex);
  std::condition_variable_any timer;
  timer.wait_for(lock, stop, time, [] { return false; });
  return !stop.stop_requested();
}

}  // namespace

bool Debouncer::accept(const GpioEdge& edge) {
  const auto [last, first] = last_ns_.try_emplace(edge.line, edge.edge_ns);
  if (first) return true;
  if (edge.edge_ns - last->second < quiet_ns_) return false;
  last->second = edge.edge_ns;
  return true;
}

GpioStamps::GpioStamps(GpioStampsOptions options, Listeners listeners, Open open)
    : options_(std::move(options)),
      listeners_(std::move(listeners)),
      open_(open ? std::move(open) : [chip = options_.chip](const std::vector<LineWanted>& lines) {
        return EdgeLines::open(chip, lines);
      }) {
  status_.problem = options_.chip + ": not open yet";
}

GpioStamps::~GpioStamps() { stop(); }

void GpioStamps::start() {
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void GpioStamps::stop() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  thread_.join();
}

GpioStatus GpioStamps::status() const {
  const std::scoped_lock lock(mutex_);
  return status_;
}

void GpioStamps::run(const std::stop_token& stop) {
  std::vector<LineWanted> wanted;
  if (options_.exposure) wanted.push_back(*options_.exposure);
  if (options_.pps) wanted.push_back(*options_.pps);
  bool lost = false;
  do {
    auto lines = open_(wanted);
    {
      const std::scoped_lock lock(mutex_);
      status_.open = lines.has_value();
      const std::string problem = lines ? "" : lines.error().message;
      if (!problem.empty() && problem != status_.problem) ++status_.problems;
      status_.problem = problem;
      if (lines && lost) ++status_.reopened;
    }
    if (!lines) continue;
    serve(**lines, stop);
    lost = true;
  } while (pause(stop, options_.retry));
}

void GpioStamps::serve(EdgeLines& lines, const std::stop_token& stop) {
  Debouncer debouncer(options_.debounce_ns);
  while (!stop.stop_requested()) {
    const std::int64_t before = detail::boottimeNow();
    const auto edges = lines.wait(kWait);
    if (!edges) {
      const std::scoped_lock lock(mutex_);
      status_.open = false;
      status_.problem = edges.error().message;
      ++status_.problems;
      return;
    }
    for (const GpioEdge& edge : *edges) {
      const bool exposure = options_.exposure && edge.line == options_.exposure->line;
      const bool good = debouncer.accept(edge);
      {
        const std::scoped_lock lock(mutex_);
        ++(!good ? status_.bounced : exposure ? status_.exposures : status_.pps);
      }
      if (!good) continue;
      if (exposure && listeners_.exposure) listeners_.exposure(edge.edge_ns);
      if (!exposure && listeners_.pps) listeners_.pps(edge.edge_ns);
    }
    // Edges from before the wait are told now; a kernel needs well below a millisecond to queue one.
    if (listeners_.quiet) listeners_.quiet(before - 1'000'000);
    // Last: a recording that is busy with a frame must not keep a pulse from the next one.
    if (listeners_.raw)
      for (const GpioEdge& edge : *edges) listeners_.raw(edge);
  }
}

TriggerOutput::TriggerOutput(TriggerOptions options, Open open)
    : options_(std::move(options)),
      open_(open ? std::move(open)
                 : [chip = options_.chip, line = options_.line] { return OutputLine::open(chip, line); }) {}

TriggerOutput::~TriggerOutput() { stop(); }

void TriggerOutput::start() {
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void TriggerOutput::stop() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  thread_.join();
}

TriggerStatus TriggerOutput::status() const {
  const std::scoped_lock lock(mutex_);
  return status_;
}

void TriggerOutput::run(const std::stop_token& stop) {
  using Clock = std::chrono::steady_clock;
  do {
    auto line = open_();
    {
      const std::scoped_lock lock(mutex_);
      status_.problem = line ? "" : line.error().message;
    }
    if (!line) continue;
    Clock::time_point due = Clock::now();
    for (;;) {
      due += options_.interval;
      if (due < Clock::now()) due = Clock::now();  // a machine that slept does not catch up in a burst
      if (!pause(stop, due - Clock::now())) return;
      const auto late = Clock::now() - due;
      auto done = (*line)->set(true);
      if (!pause(stop, options_.width)) {
        (void)(*line)->set(false);
        return;
      }
      if (done) done = (*line)->set(false);
      const std::scoped_lock lock(mutex_);
      if (!done) {
        status_.problem = done.error().message;
        break;
      }
      ++status_.pulses;
      status_.worst_late_ns =
          std::max<std::int64_t>(status_.worst_late_ns, std::chrono::nanoseconds(late).count());
    }
  } while (pause(stop, std::chrono::seconds(1)));
}

}  // namespace overfly::capture
