#include "daemon/overflyd/pipeline.h"

#include <fmt/format.h>
#include <pthread.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>

#include "capture/replay/replay_source.h"
#include "config/niceness.h"
#include "daemon/overflyd/boot_clock.h"
#include "daemon/overflyd/log.h"
#include "daemon/overflyd/options.h"

// The pipeline as a whole, and its capture thread.
namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kFramesInMemory = 16;  // of those that wait; the others are read again from disk

}  // namespace

Pipeline::Pipeline(const config::Settings& settings, std::unique_ptr<capture::FrameSource> source,
                   std::filesystem::path folder, gl::GlThread& gl)
    : settings_(settings),
      gl_(gl),
      source_(std::move(source)),
      live_(dynamic_cast<capture::LiveSource*>(source_.get())),
      folder_(std::move(folder)) {
  status_.source = source_->describe();
}

Pipeline::~Pipeline() { stop(); }

Result<void> Pipeline::start() {
  std::error_code code;
  std::filesystem::create_directories(folder_, code);
  if (code)
    return fail(ErrorCode::Io, fmt::format("{} cannot be made: {}", folder_.string(), code.message()));
  auto recorded = RecordedFrames::open(folder_);
  if (!recorded) return tl::unexpected(recorded.error());
  recorded_ = std::move(*recorded);
  // Without it nothing is known of this device the next time.
  std::filesystem::create_directory(deviceFolder(settings_), code);
  if (auto info = recorded_->earlierInfo()) flight_info_ = std::move(*info);
  // What earlier runs recorded is mapped first.
  for (std::uint64_t id = 0; id < recorded_->earlier(); ++id) {
    const capture::FlightFrame& entry = *recorded_->entryOf(id);
    queueFor(entry.frame, entry.raw).push_back({id, nullptr, now_ns(), false, entry.raw});
  }
  status_.seen = recorded_->earlier();
  if (live_ != nullptr && settings_.record.raw_inputs)
    live_->onRaw([this](const capture::RawInput& input) { recorded_->record(input); });
  const auto launch = [this](Stage stage, void (Pipeline::*body)(const std::stop_token&)) {
    threads_.emplace_back([this, stage, body](const std::stop_token& stop) { runStage(stage, body, stop); });
  };
  launch(Stage::Encoding, &Pipeline::encode);
  launch(Stage::Mapping, &Pipeline::map);
  launch(Stage::Adjusting, &Pipeline::adjust);
  launch(Stage::Capture, &Pipeline::capture);
  return {};
}

void Pipeline::runStage(Stage stage, void (Pipeline::*body)(const std::stop_token&),
                        const std::stop_token& stop) {
  beat(stage);
  // For top -H; a thread's name has 15 letters at most.
  (void)pthread_setname_np(pthread_self(), std::string(kStageNames[static_cast<std::size_t>(stage)]).c_str());
  if (stage != Stage::Capture) standBack(kMappingNiceness);
  try {
    (this->*body)(stop);
  } catch (const std::exception& thrown) {
    giveUp({ErrorCode::Internal, fmt::format("the {} stage broke: {}",
                                             kStageNames[static_cast<std::size_t>(stage)], thrown.what())});
  }
  hearts_[static_cast<std::size_t>(stage)].excuse();  // it has ended
}

void Pipeline::begin(Stage stage) {
  beat(stage);
  if (hook_) hook_(stage, pieces_[static_cast<std::size_t>(stage)]++);
}

void Pipeline::endSource() {
  closing_ = true;
  source_->stop();
  wake_.notify_all();
}

void Pipeline::stop() {
  if (threads_.empty()) return;
  source_->stop();
  // Capture first, then adjusting, mapping, then encoding what mapping still handed on.
  for (auto thread = threads_.rbegin(); thread != threads_.rend(); ++thread) {
    thread->request_stop();
    wake_.notify_all();
    thread->join();
  }
  threads_.clear();
  if (live_ != nullptr) live_->onRaw({});
  recorded_->close();
  reader_.reset();
  writer_.reset();
}

void Pipeline::reload(const config::Settings& settings) {
  const std::scoped_lock lock(mutex_);
  settings_ = settings;
  reloaded_ = true;
}

PipelineStatus Pipeline::status() const {
  const std::scoped_lock lock(mutex_);
  PipelineStatus status = status_;
  status.waiting_frames = frames_.size() + to_adjust_.size() + status.adjust.waiting;
  for (const auto* queue : {&to_adjust_, &frames_})
    if (!queue->empty())
      status.lag_s = std::max(status.lag_s, static_cast<double>(now_ns() - queue->front().arrived_ns) / 1e9);
  status.provisional_s = provisional_.summary();
  status.swept_s = swept_.summary();
  for (std::size_t i = 0; i < kStageNames.size(); ++i)
    if (hearts_[i].silence() > kStageSilence) status.stuck.emplace_back(kStageNames[i]);
  return status;
}

void Pipeline::interest(const geo::TileKey& key) {
  const std::scoped_lock lock(mutex_);
  if (interests_.size() < 256) interests_.push_back(key);
}

void Pipeline::giveUp(const Error& error) {
  spdlog::error("{}", error.message);
  const std::scoped_lock lock(mutex_);
  if (status_.failed) return;
  status_.failed = true;
  status_.bad_settings = error.code == ErrorCode::BadSettings;
  status_.error = error.message;
}

// Work that was put aside in the middle because of the stop is made anew when the mission is taken up.
void Pipeline::stopped(const Error& error, const std::stop_token& stop) {
  if (!stop.stop_requested()) giveUp(error);
}

void Pipeline::refuse(std::uint64_t id, const std::string& reason) {
  warnOnce(reason, fmt::format("frame {} is recorded but not mapped: {}", id, reason));
  const std::scoped_lock lock(mutex_);
  ++status_.refused[reason];
}

// --- capture -----------------------------------------------------------------------------------------------

void Pipeline::capture(const std::stop_token& stop) {
  std::string last_problem;
  bool opened = false;
  while (!stop.stop_requested() && !closing_ && !opened) {
    // Reading the table of a long flight takes its time.
    hearts_[static_cast<std::size_t>(Stage::Capture)].excuse();
    const auto ok = source_->open();
    beat(Stage::Capture);
    opened = ok.has_value();
    if (opened) break;
    if (ok.error().code == ErrorCode::BadSettings || ok.error().code == ErrorCode::NotFound)
      return giveUp(ok.error());
    if (ok.error().message != last_problem) spdlog::warn("{}: {}", source_->describe(), ok.error().message);
    last_problem = ok.error().message;
    std::unique_lock lock(mutex_);
    const std::chrono::duration<double> pause(settings_.source.retry_s);
    for (const auto until = std::chrono::steady_clock::now() + pause;
         std::chrono::steady_clock::now() < until && !stop.stop_requested() && !closing_;) {
      beat(Stage::Capture);
      wake_.wait_for(lock, stop, 500ms, [this] { return closing_.load(); });
    }
  }
  if (opened) {
    takeFrames(stop);
    source_->close();
  }
  if (stop.stop_requested()) return;
  const std::scoped_lock lock(mutex_);
  status_.source_open = false;
  status_.source_ended = true;
  status_.idle = false;  // until what follows the last frame is done
  wake_.notify_all();
}

// Recording needs room; asked now and then, because the disk is shared.
bool Pipeline::hasRoom() {
  int needed_mb = 0;
  {
    const std::scoped_lock lock(mutex_);
    needed_mb = settings_.record.min_free_mb;
  }
  std::error_code code;
  const auto space = std::filesystem::space(folder_, code);
  return code || space.available >= static_cast<std::uintmax_t>(needed_mb) << 20;
}

void Pipeline::takeFrames(const std::stop_token& stop) {
  capture::FlightInfo info;
  std::map<std::uint64_t, capture::TelemetryPtr> raw_of;  // by sequence number
  bool plays_again = false;  // a flight from its beginning, of which an earlier run has recorded a part
  if (const auto* replay = dynamic_cast<const capture::ReplaySource*>(source_.get());
      replay != nullptr && replay->flight()) {
    info = replay->flight()->info();
    plays_again = true;
    for (const capture::FlightFrame& entry : replay->flight()->frames())
      if (entry.raw) raw_of.emplace(entry.frame.sequence, entry.raw);
  }
  info.source = source_->describe();
  info.made_by = "overflyd";
  {
    const std::scoped_lock lock(mutex_);
    plays_again = plays_again && !settings_.source.loop;
    flight_info_ = info;
    status_.source_open = true;
  }
  while (!stop.stop_requested()) {
    auto frame = source_->next(500ms);
    beat(Stage::Capture);
    takeLatePoses();
    if (!frame) {
      if (frame.error().code == ErrorCode::Unavailable) continue;
      warnOnce("unreadable frame", fmt::format("frame: {}", frame.error().message));
      const std::scoped_lock lock(mutex_);
      ++status_.refused["unreadable"];
      continue;
    }
    if (*frame == nullptr) return;
    if (plays_again && recorded_->hasEarlier((*frame)->name)) continue;
    begin(Stage::Capture);
    const std::int64_t arrived_ns = now_ns();
    info.datum = (*frame)->datum;
    if (live_ != nullptr && !info.ground_height_m && (*frame)->pose) {
      if (const auto autopilot = live_->status().autopilot)
        info.ground_height_m = autopilot->telemetry.home_height_m;
      if (info.ground_height_m) {
        info.ground_reason = "where the vehicle took off";
        const std::scoped_lock lock(mutex_);
        flight_info_ = info;
      }
    }
    capture::TelemetryPtr raw;
    if (const auto found = raw_of.find((*frame)->sequence); found != raw_of.end()) raw = found->second;
    const char* refusal = hasRoom() ? nullptr : "no room to record";
    Result<std::uint64_t> id = 0;
    if (refusal != nullptr) {
      warnOnce(refusal, fmt::format("{} is not recorded: the disk has less than record.min_free_mb left",
                                    (*frame)->name));
    } else if (id = recorded_->record(**frame, info, raw); !id) {
      refusal = "not recorded";
      warnOnce(refusal, fmt::format("recording {}: {}", (*frame)->name, id.error().message));
    }
    const std::scoped_lock lock(mutex_);
    ++status_.seen;
    status_.record_s += static_cast<double>(now_ns() - arrived_ns) / 1e9;
    if (refusal != nullptr) {
      ++status_.refused[refusal];
      continue;
    }
    status_.idle = false;
    std::deque<Waiting>& queue = queueFor(**frame, raw);
    queue.push_back({*id, *frame, arrived_ns, false, raw});
    if (queue.size() > kFramesInMemory) queue[queue.size() - 1 - kFramesInMemory].frame = nullptr;
    wake_.notify_all();
  }
}

void Pipeline::takeLatePoses() {
  for (const capture::LatePose& late : source_->takeLatePoses()) {
    auto id = recorded_->record(late);
    if (!id) {
      warnOnce("late pose", fmt::format("a pose that came late: {}", id.error().message));
      continue;
    }
    const std::scoped_lock lock(mutex_);
    ++status_.late_poses;
    const bool as_it_is = settings_.adjust.mode == config::AdjustMode::Off;
    (as_it_is ? frames_ : to_adjust_).push_back({*id, nullptr, now_ns()});
    wake_.notify_all();
  }
}

}  // namespace overfly::daemon
