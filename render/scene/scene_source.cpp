#include "render/scene/scene_source.h"

#include <fmt/format.h>
#include <time.h>

#include <cmath>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>

#include "render/scene/detail/jpeg.h"
#include "render/scene/renderer.h"

namespace overfly::scene {
namespace {

using Clock = std::chrono::steady_clock;

std::int64_t nowOn(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

}  // namespace

struct SceneSource::State {
  std::filesystem::path file;
  SceneSourceOptions options;
  std::shared_ptr<const World> world;
  FlightPlan plan;

  // Set by open() before the thread starts, constant while it runs.
  std::int64_t start_ns = 0, utc_offset_ns = 0;
  Clock::time_point started;
  std::jthread thread;

  std::mutex mutex;  // guards what follows
  std::condition_variable_any changed;
  std::deque<Result<capture::FramePtr>> ready;
  std::size_t handed_on = 0;  // index into plan.frames
  bool finished = false;      // the thread has rendered all, or failed
  bool stopped = false;

  void renderAll(const std::stop_token& stop);
  void push(Result<capture::FramePtr> frame, const std::stop_token& stop);
  [[nodiscard]] Result<capture::FramePtr> make(Renderer& renderer, const PlannedFrame& planned);
  void join();
};

void SceneSource::State::push(Result<capture::FramePtr> frame, const std::stop_token& stop) {
  std::unique_lock lock(mutex);
  changed.wait(lock, stop,
               [&] { return ready.size() < static_cast<std::size_t>(std::max(1, options.ahead)); });
  if (stop.stop_requested()) return;
  ready.push_back(std::move(frame));
  changed.notify_all();
}

Result<capture::FramePtr> SceneSource::State::make(Renderer& renderer, const PlannedFrame& planned) {
  Result<Picture> picture = renderer.render(planned.picture);
  if (!picture) return tl::unexpected<Error>(picture.error());
  const std::vector<EffectSettings>& effects = world->description.effects;
  auto frame = std::make_shared<capture::Frame>();
  frame->sequence = static_cast<std::uint64_t>(planned.frame);
  frame->name = fmt::format("{:08}.{}", planned.frame, findEffect(effects, Effect::Jpeg) ? "jpg" : "rgb");
  frame->camera_id = "simulated";
  frame->time_ns = start_ns + std::llround(planned.time_s * 1e9);
  frame->utc_offset_ns = utc_offset_ns;
  if (const EffectSettings* blur = findEffect(effects, Effect::MotionBlur))
    frame->exposure_ns = std::llround((*blur)["exposure_ms"] * 1e6);
  if (const EffectSettings* noise = findEffect(effects, Effect::SensorNoise)) frame->gain = (*noise)["gain"];
  frame->camera = renderer.camera();
  frame->pose = planned.recorded;
  if (frame->pose) frame->pose->time_ns = frame->time_ns;
  frame->pose_is_adjusted = plan.poses_are_exact;
  frame->datum = capture::VerticalDatum::Ellipsoid;
  frame->image.width = picture->width;
  frame->image.height = picture->height;
  if (const EffectSettings* jpeg = findEffect(effects, Effect::Jpeg)) {
    Result<std::vector<std::uint8_t>> bytes =
        encodeJpeg(*picture, static_cast<int>((*jpeg)["quality"]), (*jpeg)["subsampling"] > 0.5);
    if (!bytes) return tl::unexpected<Error>(bytes.error());
    frame->image.format = capture::PixelFormat::Jpeg;
    frame->image.bytes = std::move(*bytes);
  } else {
    frame->image.format = capture::PixelFormat::Rgb8;
    frame->image.stride = 3 * picture->width;
    frame->image.bytes = std::move(picture->rgb);
  }
  return capture::FramePtr(std::move(frame));
}

void SceneSource::State::renderAll(const std::stop_token& stop) {
  const auto done = [&] {
    const std::lock_guard lock(mutex);
    finished = true;
    changed.notify_all();
  };
  Result<gl::Context> context = gl::Context::create(options.gpu);
  if (!context) {
    push(fail(ErrorCode::Unavailable, context.error().message), stop);
    return done();
  }
  Result<std::unique_ptr<Renderer>> renderer = Renderer::create(*context, world);
  if (!renderer) {
    push(tl::unexpected<Error>(renderer.error()), stop);
    return done();
  }
  for (const PlannedFrame& planned : plan.frames) {
    if (stop.stop_requested()) break;
    Result<capture::FramePtr> frame = make(**renderer, planned);
    const bool good = frame.has_value();
    push(std::move(frame), stop);
    if (!good) break;  // a lost context does not come back by itself: close() and open() again
  }
  renderer->reset();
  done();
}

void SceneSource::State::join() {
  if (!thread.joinable()) return;
  thread.request_stop();
  thread.join();
}

SceneSource::SceneSource(std::filesystem::path file_or_name, SceneSourceOptions options)
    : state_(std::make_unique<State>()) {
  state_->file = std::move(file_or_name);
  state_->options = options;
}

SceneSource::SceneSource(std::shared_ptr<const World> world, SceneSourceOptions options)
    : state_(std::make_unique<State>()) {
  state_->file = world->description.name;
  state_->world = std::move(world);
  state_->options = options;
}

SceneSource::~SceneSource() { state_->join(); }

Result<void> SceneSource::open() {
  close();
  if (!state_->world) {
    const Result<SceneDescription> description = loadScene(state_->file);
    if (!description) return tl::unexpected<Error>(description.error());
    Result<std::shared_ptr<const World>> world = buildWorld(*description);
    if (!world) return tl::unexpected<Error>(world.error());
    state_->world = std::move(*world);
  }
  const SceneDescription& scene = state_->world->description;
  state_->plan = planFlight(*state_->world, FlightPath(scene.path, scene.camera, scene.seed));
  state_->start_ns = state_->options.live_clock ? nowOn(CLOCK_BOOTTIME) : kFlightStart_ns;
  state_->utc_offset_ns = state_->options.live_clock ? nowOn(CLOCK_REALTIME) - nowOn(CLOCK_BOOTTIME)
                                                     : kFlightStartUtc_ns - kFlightStart_ns;
  state_->started = Clock::now();
  const std::lock_guard lock(state_->mutex);
  state_->ready.clear();
  state_->handed_on = 0;
  state_->finished = state_->stopped = false;
  state_->thread =
      std::jthread([state = state_.get()](const std::stop_token& stop) { state->renderAll(stop); });
  return {};
}

Result<capture::FramePtr> SceneSource::next(std::chrono::milliseconds timeout) {
  State& state = *state_;
  const auto until = Clock::now() + timeout;
  std::unique_lock lock(state.mutex);
  if (!state.thread.joinable() && !state.stopped)
    return fail(ErrorCode::Unavailable, "the scene is not open");
  const auto over = [&] { return state.stopped || (state.finished && state.ready.empty()); };
  if (!state.changed.wait_until(lock, until, [&] { return over() || !state.ready.empty(); })) {
    return fail(ErrorCode::Unavailable, "the next frame is not rendered yet");
  }
  if (over()) return capture::FramePtr();
  if (state.ready.front() && state.options.speed > 0) {
    const PlannedFrame& planned = state.plan.frames[state.handed_on];
    const auto due =
        state.started + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(
                            planned.time_s / state.options.speed + planned.late_s));
    state.changed.wait_until(lock, std::min(due, until), [&] { return state.stopped; });
    if (state.stopped) return capture::FramePtr();
    if (Clock::now() < due) return fail(ErrorCode::Unavailable, "the next frame is not due yet");
  }
  Result<capture::FramePtr> frame = std::move(state.ready.front());
  state.ready.pop_front();
  ++state.handed_on;
  state.changed.notify_all();
  return frame;
}

void SceneSource::stop() {
  const std::lock_guard lock(state_->mutex);
  state_->stopped = true;
  state_->thread.request_stop();
  state_->changed.notify_all();
}

void SceneSource::close() {
  stop();
  state_->join();
  const std::lock_guard lock(state_->mutex);
  state_->ready.clear();
}

std::string SceneSource::describe() const { return "scene:" + state_->file.string(); }
std::shared_ptr<const World> SceneSource::world() const { return state_->world; }
const FlightPlan& SceneSource::plan() const { return state_->plan; }

}  // namespace overfly::scene
