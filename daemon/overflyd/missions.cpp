#include "daemon/overflyd/missions.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <fstream>
#include <tuple>

namespace overfly::daemon {
namespace {

constexpr std::chrono::milliseconds kLook{500};  // how old the list of folders may be
constexpr const char* kEndedFile = "ended";      // everything that was recorded is in the map
constexpr const char* kClosedFile = "closed";    // takes no more frames; may still have to be mapped
constexpr const char* kBegunFile = "begun";      // its time is the mission's

// For what is only mapped to its end.
class NothingMore final : public capture::FrameSource {
 public:
  Result<void> open() override { return {}; }
  Result<capture::FramePtr> next(std::chrono::milliseconds) override { return capture::FramePtr{}; }
  void stop() override {}
  void close() override {}
  [[nodiscard]] std::string describe() const override { return "none: mapped to its end"; }
};

bool isName(const std::string& name) {
  return !name.empty() && name.size() <= 100 && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) {
           return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
         });
}

std::string nameByTime() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char name[32];
  std::strftime(name, sizeof name, "%Y%m%dT%H%M%SZ", &utc);
  return name;
}

void leaveMark(const std::filesystem::path& path) { std::ofstream(path, std::ios::app).flush(); }

std::int64_t begunNs(const std::filesystem::path& folder) {
  std::error_code code;
  auto time = std::filesystem::last_write_time(folder / kBegunFile, code);
  if (code) time = std::filesystem::last_write_time(folder, code);
  if (code) return 0;
  const auto system = std::chrono::file_clock::to_sys(time);
  return std::chrono::duration_cast<std::chrono::nanoseconds>(system.time_since_epoch()).count();
}

}  // namespace

std::vector<std::string> missionsIn(const std::filesystem::path& root) {
  std::vector<std::pair<std::int64_t, std::string>> found;
  std::error_code code;
  for (const auto& entry : std::filesystem::directory_iterator(root, code)) {
    if (!entry.is_directory(code)) continue;
    const auto& path = entry.path();
    if (std::filesystem::exists(path / "map.overfly") || std::filesystem::exists(path / "flight-1") ||
        std::filesystem::exists(path / kBegunFile))
      found.emplace_back(begunNs(path), path.filename().string());
  }
  std::sort(found.begin(), found.end());
  std::vector<std::string> names;
  for (auto& [time, name] : found) names.push_back(std::move(name));
  return names;
}

Missions::Missions(const config::Settings& settings, gl::GlThread& gl, MakeSource make_source,
                   std::function<void()> on_commit)
    : settings_(settings), gl_(gl), make_source_(std::move(make_source)), on_commit_(std::move(on_commit)) {}

Missions::~Missions() { shutDown(); }

Result<void> Missions::launch(const std::string& name, std::unique_ptr<capture::FrameSource> source,
                              bool live) {
  const std::filesystem::path folder = settings_.map.folder / name;
  std::error_code code;
  std::filesystem::create_directories(folder, code);
  if (code) return fail(ErrorCode::Io, fmt::format("{} cannot be made: {}", folder.string(), code.message()));
  if (!std::filesystem::exists(folder / kBegunFile)) leaveMark(folder / kBegunFile);
  auto pipeline = std::make_shared<Pipeline>(settings_, std::move(source), folder, gl_);
  pipeline->onCommit(on_commit_);
  pipeline->setStageHook(hook_);
  pipeline->setGpuHook(gpu_hook_);
  if (const auto& plan = settings_.plan.area_file; live && !plan.empty()) {
    // Where the link keeps it; one that was put there by a client stays.
    std::filesystem::copy_file(plan, folder / "map.overfly.plan.geojson",
                               std::filesystem::copy_options::skip_existing, code);
    if (code) spdlog::error("plan.area_file: {}: {}", plan.string(), code.message());
  }
  if (auto ok = pipeline->start(); !ok) return tl::unexpected(ok.error());
  running_.push_back({name, pipeline, live});
  looked_at_ = {};
  if (live || !shown_) {
    shown_ = pipeline;
    shown_name_ = name;
  }
  return {};
}

Result<bool> Missions::resume() {
  const std::scoped_lock lock(mutex_);
  const std::filesystem::path& root = settings_.map.folder;
  std::vector<std::string> names = missionsIn(root);
  bool live = false;
  for (auto name = names.rbegin(); name != names.rend(); ++name) {
    if (std::filesystem::exists(root / *name / kEndedFile)) continue;
    const bool takes_frames = name == names.rbegin() && !std::filesystem::exists(root / *name / kClosedFile);
    std::unique_ptr<capture::FrameSource> source;
    if (takes_frames) {
      auto made = make_source_();
      if (!made) return tl::unexpected(made.error());
      source = std::move(*made);
    } else {
      source = std::make_unique<NothingMore>();
    }
    if (auto ok = launch(*name, std::move(source), takes_frames); !ok) {
      if (takes_frames) return tl::unexpected(ok.error());
      spdlog::error("mission {} cannot be taken up: {}", *name, ok.error().message);
      continue;
    }
    spdlog::info("mission {} goes on", *name);
    live = live || takes_frames;
  }
  if (shown_name_.empty() && !names.empty()) shown_name_ = names.back();
  return live;
}

Result<MissionInfo> Missions::start(const std::string& wanted) {
  const std::scoped_lock lock(mutex_);
  for (const Running& running : running_)
    if (running.live)
      return fail(ErrorCode::BadInput, fmt::format("mission {} is live: stop it first", running.name));
  std::string name = wanted.empty() ? nameByTime() : wanted;
  if (!isName(name))
    return fail(ErrorCode::BadInput,
                "a mission's name has letters, digits, '-', '_' and '.', at most 100, and no leading '.'");
  const auto taken = [&] { return std::filesystem::exists(settings_.map.folder / name); };
  if (taken() && !wanted.empty())
    return fail(ErrorCode::BadInput, fmt::format("there is a mission {} already: take another name", name));
  for (int i = 2; taken(); ++i) name = fmt::format("{}-{}", nameByTime(), i);
  auto source = make_source_();
  if (!source) return tl::unexpected(source.error());
  if (auto ok = launch(name, std::move(*source), true); !ok) return tl::unexpected(ok.error());
  spdlog::info("mission {} starts", name);
  const std::filesystem::path folder = settings_.map.folder / name;
  return MissionInfo{name, folder / "map.overfly", begunNs(folder), true, true};
}

Result<void> Missions::stop() {
  const std::scoped_lock lock(mutex_);
  for (Running& running : running_) {
    if (!running.live) continue;
    running.live = false;
    leaveMark(settings_.map.folder / running.name / kClosedFile);
    running.pipeline->endSource();
    spdlog::info("mission {} takes no more frames", running.name);
    return {};
  }
  return fail(ErrorCode::BadInput, "no mission is live");
}

void Missions::armed(bool is_armed) {
  {
    const std::scoped_lock lock(mutex_);
    if (settings_.mission.start != config::MissionStart::Arming) return;
  }
  const auto missions = list();
  const bool live = std::any_of(missions.begin(), missions.end(), [](const auto& m) { return m.live; });
  if (live == is_armed) return;
  if (is_armed) {
    if (auto started = start(); !started)
      spdlog::error("armed, but no mission starts: {}", started.error().message);
  } else {
    (void)stop();
  }
}

std::vector<MissionInfo> Missions::list() const {
  const std::scoped_lock lock(mutex_);
  if (const auto now = std::chrono::steady_clock::now(); now - looked_at_ > kLook) {
    looked_at_ = now;
    listed_.clear();
    for (const std::string& name : missionsIn(settings_.map.folder)) {
      const std::filesystem::path folder = settings_.map.folder / name;
      listed_.push_back({name, folder / "map.overfly", begunNs(folder), false, false});
    }
  }
  std::vector<MissionInfo> missions = listed_;
  for (MissionInfo& mission : missions) {
    mission.current = mission.name == shown_name_;
    for (const Running& running : running_)
      if (running.name == mission.name)
        mission.live = running.live && !running.pipeline->status().source_ended;
  }
  return missions;
}

std::shared_ptr<Pipeline> Missions::current() const {
  const std::scoped_lock lock(mutex_);
  return shown_;
}

std::string Missions::currentName() const {
  const std::scoped_lock lock(mutex_);
  return shown_name_;
}

std::vector<std::shared_ptr<Pipeline>> Missions::running() const {
  const std::scoped_lock lock(mutex_);
  std::vector<std::shared_ptr<Pipeline>> pipelines;
  for (const Running& running : running_) pipelines.push_back(running.pipeline);
  return pipelines;
}

std::vector<std::string> Missions::tidy() {
  std::vector<Running> done;
  {
    const std::scoped_lock lock(mutex_);
    const auto at_end = std::stable_partition(running_.begin(), running_.end(), [](const Running& running) {
      const PipelineStatus status = running.pipeline->status();
      return !(status.source_ended && status.idle);
    });
    std::move(at_end, running_.end(), std::back_inserter(done));
    running_.erase(at_end, running_.end());
  }
  std::vector<std::string> names;
  for (const Running& running : done) {
    running.pipeline->stop();
    leaveMark(settings_.map.folder / running.name / kEndedFile);
    spdlog::info("mission {} is mapped to its end", running.name);
    names.push_back(running.name);
  }
  return names;
}

void Missions::reload(const config::Settings& settings) {
  const std::scoped_lock lock(mutex_);
  settings_ = settings;
  for (const Running& running : running_) running.pipeline->reload(settings);
}

void Missions::shutDown() {
  std::vector<Running> running;
  {
    const std::scoped_lock lock(mutex_);
    running.swap(running_);
  }
  for (const Running& one : running) {
    const PipelineStatus status = one.pipeline->status();
    one.pipeline->stop();
    if (status.source_ended && status.idle) leaveMark(settings_.map.folder / one.name / kEndedFile);
  }
}

}  // namespace overfly::daemon
