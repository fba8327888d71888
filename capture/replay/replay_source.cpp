#include "capture/replay/replay_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <limits>
#include <mutex>
#include <random>

namespace overfly::capture {
namespace {

using Clock = std::chrono::steady_clock;

enum class Fault : std::uint64_t { Drop = 1, Duplicate, Reorder, CorruptJpeg, LosePose, Stall };

// Random numbers that belong to one fault of one frame and to nothing else.
std::mt19937_64 randomOf(std::uint64_t seed, Fault fault, std::uint64_t frame) {
  std::seed_seq sequence{seed, seed >> 32, static_cast<std::uint64_t>(fault), frame, frame >> 32};
  return std::mt19937_64(sequence);
}

bool happens(const ReplayFaults& faults, double share, Fault fault, std::uint64_t frame) {
  if (!(share > 0)) return false;
  std::mt19937_64 random = randomOf(faults.seed, fault, frame);
  return std::uniform_real_distribution(0.0, 1.0)(random) < share;
}

void corrupt(std::vector<std::uint8_t>& bytes, std::mt19937_64 random) {
  if (bytes.size() < 4) return;
  if (random() % 2 == 0) {
    bytes.resize(bytes.size() / 4 + random() % (bytes.size() / 2));
    return;
  }
  for (int i = 0; i < 64; ++i) bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
}

}  // namespace

// One frame of the play: which one, in which round, and when it is due.
struct Due {
  std::size_t index = 0;
  std::uint64_t round = 0;
  std::uint64_t count = 0;  // frames of the play before this one: what faults are drawn by
  std::int64_t time_ns = 0;
};

struct ReplaySource::State {
  std::filesystem::path folder;
  ReplayOptions options;

  mutable std::mutex mutex;  // guards what follows; stop() and flight() come from other threads
  std::condition_variable wake;
  std::shared_ptr<const Flight> flight;
  bool stopped = false;

  // What follows belongs to the thread that calls open, next and close.
  bool is_open = false;
  Due next;  // the frame after those in `queue`
  bool at_end = false;
  std::deque<Due> queue;  // reordered and duplicated frames, in the order in which they come
  Clock::time_point started;
  std::int64_t first_time_ns = 0;
  std::chrono::nanoseconds stalled{0};
  std::optional<std::uint64_t> stalled_before;  // the frame that the last stall came before
  std::int64_t round_length_ns = 0;
  std::uint64_t round_sequences = 0;

  Due take() {
    const Due due = next;
    ++next.count;
    if (++next.index >= flight->size()) {
      next.index = 0;
      ++next.round;
      at_end = !options.loop;
    }
    next.time_ns =
        flight->at(next.index).frame.time_ns + static_cast<std::int64_t>(next.round) * round_length_ns;
    return due;
  }

  // Fills the queue with what comes next; false at the end.
  bool prepare() {
    const ReplayFaults& faults = options.faults;
    while (queue.empty() && !at_end) {
      const Due due = take();
      if (happens(faults, faults.drop, Fault::Drop, due.count)) continue;
      const bool twice = happens(faults, faults.duplicate, Fault::Duplicate, due.count);
      if (!at_end && happens(faults, faults.reorder, Fault::Reorder, due.count)) queue.push_back(take());
      queue.push_back(due);
      if (twice) queue.push_back(due);
    }
    return !queue.empty();
  }

  // When the frame is to be handed over.
  Clock::time_point timeOf(const Due& due) const {
    if (!(options.speed > 0)) return started + stalled;
    const double behind_ns = static_cast<double>(due.time_ns - first_time_ns) / options.speed;
    return started + stalled + std::chrono::nanoseconds(static_cast<std::int64_t>(std::min(behind_ns, 4e18)));
  }

  Result<FramePtr> load(const Due& due) const {
    auto loaded = flight->load(due.index);
    const ReplayFaults& faults = options.faults;
    const bool corrupts = happens(faults, faults.corrupt_jpeg, Fault::CorruptJpeg, due.count);
    const bool loses = happens(faults, faults.lose_pose, Fault::LosePose, due.count);
    if (!loaded) {
      // An unreadable image ends neither the flight nor the consumer.
      return fail(ErrorCode::BadInput, loaded.error().message);
    }
    if (due.round == 0 && !corrupts && !loses) return loaded;
    auto frame = std::make_shared<Frame>(**loaded);
    const std::int64_t shift = due.time_ns - frame->time_ns;
    frame->time_ns += shift;
    if (frame->pose) frame->pose->time_ns += shift;
    frame->sequence += due.round * round_sequences;
    if (loses) {
      frame->pose.reset();
      frame->pose_is_adjusted = false;
    }
    if (corrupts && frame->image.format == PixelFormat::Jpeg) {
      corrupt(frame->image.bytes, randomOf(faults.seed + 1, Fault::CorruptJpeg, due.count));
    }
    return FramePtr(std::move(frame));
  }
};

ReplaySource::ReplaySource(std::filesystem::path folder, ReplayOptions options)
    : state_(std::make_unique<State>()) {
  state_->folder = std::move(folder);
  state_->options = std::move(options);
}

ReplaySource::ReplaySource(std::shared_ptr<const Flight> flight, ReplayOptions options)
    : state_(std::make_unique<State>()) {
  state_->folder = flight->info().source;
  state_->flight = std::move(flight);
  state_->options = std::move(options);
}

ReplaySource::~ReplaySource() = default;

Result<void> ReplaySource::open() {
  State& s = *state_;
  if (s.is_open) return fail(ErrorCode::Internal, "the mock camera is open already");
  std::shared_ptr<const Flight> flight = this->flight();
  if (!flight) {
    auto read = importFlight(s.folder, s.options.import);
    if (!read) {
      const ErrorCode code =
          read.error().code == ErrorCode::NotFound ? ErrorCode::Unavailable : read.error().code;
      return fail(code, read.error().message);
    }
    flight = std::make_shared<const Flight>(std::move(*read));
  }
  const std::lock_guard lock(s.mutex);
  s.flight = flight;
  s.stopped = false;
  s.is_open = true;
  s.queue.clear();
  s.stalled = {};
  s.stalled_before.reset();
  s.next = {};
  s.at_end = s.options.start >= flight->size();
  s.started = Clock::now();
  if (s.at_end) return {};
  // A round is as long as the flight and one mean interval, so that times go on increasing.
  std::uint64_t low = std::numeric_limits<std::uint64_t>::max(), high = 0;
  for (const FlightFrame& frame : flight->frames()) {
    low = std::min(low, frame.frame.sequence);
    high = std::max(high, frame.frame.sequence);
  }
  s.round_sequences = high - low + 1;
  const std::int64_t length = flight->frames().back().frame.time_ns - flight->frames().front().frame.time_ns;
  s.round_length_ns =
      length + (flight->size() > 1
                    ? std::max<std::int64_t>(length / static_cast<std::int64_t>(flight->size() - 1), 1)
                    : 1'000'000'000);
  s.next.index = s.options.start;
  s.next.time_ns = s.first_time_ns = flight->at(s.options.start).frame.time_ns;
  return {};
}

Result<FramePtr> ReplaySource::next(std::chrono::milliseconds timeout) {
  State& s = *state_;
  if (!s.is_open) return fail(ErrorCode::Internal, "the mock camera is not open");
  const Clock::time_point deadline = Clock::now() + timeout;
  std::unique_lock lock(s.mutex);
  if (s.stopped || !s.prepare()) return FramePtr();
  const Due due = s.queue.front();
  const ReplayFaults& faults = s.options.faults;
  if (s.stalled_before != due.count && happens(faults, faults.stall, Fault::Stall, due.count)) {
    // As fast as the consumer takes them: the silence counts from now.
    if (!(s.options.speed > 0)) s.started = Clock::now() - s.stalled;
    s.stalled += faults.stall_time;
    s.stalled_before = due.count;
  }
  const Clock::time_point when = s.timeOf(due);
  if (s.wake.wait_until(lock, std::min(when, deadline), [&] { return s.stopped; })) return FramePtr();
  if (when > deadline && Clock::now() < when) return fail(ErrorCode::Unavailable, "no frame is due yet");
  s.queue.pop_front();
  lock.unlock();
  auto frame = s.load(due);
  lock.lock();
  if (s.stopped) return FramePtr();
  return frame;
}

void ReplaySource::stop() {
  {
    const std::lock_guard lock(state_->mutex);
    state_->stopped = true;
  }
  state_->wake.notify_all();
}

void ReplaySource::close() {
  const std::lock_guard lock(state_->mutex);
  state_->is_open = false;
  state_->queue.clear();
}

std::string ReplaySource::describe() const { return "replay:" + state_->folder.string(); }

std::shared_ptr<const Flight> ReplaySource::flight() const {
  const std::lock_guard lock(state_->mutex);
  return state_->flight;
}

}  // namespace overfly::capture
