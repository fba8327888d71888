#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <deque>

#include "daemon/overflyd/boot_clock.h"
#include "daemon/overflyd/options.h"
#include "daemon/overflyd/pipeline.h"

// The adjusting thread: frames whose poses are the device's own, from the capture to the mapping.
namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kFramesInMemory = 16;  // of those that wait for their neighbours
constexpr std::size_t kTimes = 500;          // frames that the median time is taken of

double quantile(std::deque<double> values, double q) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

std::deque<Pipeline::Waiting>& Pipeline::queueFor(const capture::Frame& frame,
                                                  const capture::TelemetryPtr& raw) {
  const bool nothing_known = !frame.pose && !raw;
  const bool as_it_is = frame.pose_is_adjusted || settings_.adjust.mode == config::AdjustMode::Off;
  return nothing_known || as_it_is ? frames_ : to_adjust_;
}

void Pipeline::handOn(const std::vector<tiling::adjust::LiveFrame>& ready,
                      std::map<std::uint64_t, capture::FramePtr>& in_memory) {
  for (const tiling::adjust::LiveFrame& live : ready) {
    recorded_->correct(live.id, live.pose, live.camera, live.adjusted);
    Waiting waiting{live.id, nullptr, live.since_ns, live.again};
    if (const auto held = in_memory.find(live.id); held != in_memory.end()) {
      auto frame = std::make_shared<capture::Frame>(*held->second);
      frame->pose = live.pose;
      frame->camera = live.camera;
      frame->pose_is_adjusted = live.adjusted;
      waiting.frame = std::move(frame);
      in_memory.erase(held);
    }
    const std::scoped_lock lock(mutex_);
    frames_.push_back(std::move(waiting));
    if (frames_.size() > kFramesInMemory) frames_[frames_.size() - 1 - kFramesInMemory].frame = nullptr;
  }
}

void Pipeline::adjust(const std::stop_token& stop) {
  tiling::adjust::LiveAdjustOptions options;
  {
    const std::scoped_lock lock(mutex_);
    options = adjustOptions(settings_);
  }
  options.adjuster.map.stop = stop;
  tiling::adjust::LiveAdjuster adjuster(options);
  std::map<std::uint64_t, capture::FramePtr> in_memory;  // that wait for their neighbours
  std::deque<double> seconds;
  bool landed = false;
  while (!stop.stop_requested()) {
    beat(Stage::Adjusting);
    std::optional<Waiting> waiting;
    bool landing = false;
    {
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, stop, 200ms,
                     [&] { return !to_adjust_.empty() || (status_.source_ended && !landed); });
      if (stop.stop_requested() || status_.failed) return;
      if (!to_adjust_.empty()) {
        waiting = std::move(to_adjust_.front());
        to_adjust_.pop_front();
        ++status_.adjust.waiting;  // until the adjuster's own status says so
      } else {
        landing = status_.source_ended && !landed;
      }
    }
    const std::int64_t start = now_ns();
    std::vector<tiling::adjust::LiveFrame> ready;
    if (waiting) {
      begin(Stage::Adjusting);
      auto frame = waiting->frame ? Result<capture::FramePtr>(waiting->frame) : recorded_->load(waiting->id);
      if (frame) {
        in_memory[waiting->id] = *frame;
        ready = adjuster.add(waiting->id, **frame, waiting->raw, waiting->arrived_ns, now_ns());
      } else {
        refuse(waiting->id, frame.error().message);
      }
      seconds.push_back(static_cast<double>(now_ns() - start) / 1e9);
      if (seconds.size() > kTimes) seconds.pop_front();
    } else if (landing) {
      hearts_[static_cast<std::size_t>(Stage::Adjusting)].excuse();  // a long flight takes its time
      ready = adjuster.land();
      landed = true;
    } else {
      ready = adjuster.wait(now_ns());
    }
    if (stop.stop_requested()) return;  // what an adjustment that was broken off says is not used
    handOn(ready, in_memory);
    while (in_memory.size() > kFramesInMemory) in_memory.erase(in_memory.begin());
    for (const std::string& note : adjuster.takeNotes()) spdlog::info("{}", note);
    const std::scoped_lock lock(mutex_);
    status_.adjust = adjuster.status();
    status_.adjust_median_s = quantile(seconds, 0.5);
    status_.adjust_p95_s = quantile(seconds, 0.95);
    all_handed_on_ = landed;
    if (landing) {
      status_.landing_s = static_cast<double>(now_ns() - start) / 1e9;
      if (status_.adjust.frames > 0)
        spdlog::info(
            "adjusted {} of {} frames, {} corrected again in {} batches, RMS {:.2f} px; {:.2f} s a "
            "frame (95 %: {:.2f} s), {:.1f} s after landing",
            status_.adjust.adjusted, status_.adjust.frames, status_.adjust.revised, status_.adjust.batches,
            status_.adjust.rms_px, status_.adjust_median_s, status_.adjust_p95_s, status_.landing_s);
    }
    wake_.notify_all();
  }
}

}  // namespace overfly::daemon
