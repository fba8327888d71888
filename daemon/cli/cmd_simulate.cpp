#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "daemon/cli/command.h"
#include "daemon/cli/gpu.h"
#include "daemon/cli/progress.h"
#include "render/scene/record_scene.h"
#include "render/scene/renderer.h"

namespace overfly::cli {
namespace {

struct Options {
  std::string scene;
  std::string record;
  bool explain = false, live = false;
  int frames = 0;  // 0: all
};

Result<std::shared_ptr<const scene::World>> load(const Options& options) {
  Result<scene::SceneDescription> description = scene::loadScene(options.scene);
  if (!description) return tl::unexpected<Error>(description.error());
  if (options.frames > 0) {
    description->path.frames = std::min(description->path.frames, options.frames);
    description->path.lines = std::min(description->path.lines, description->path.frames);
  }
  return scene::buildWorld(*description);
}

// The compiled graph, with what each pass costs on this machine: the mean of a few frames.
Result<int> explain(const std::shared_ptr<const scene::World>& world, const Context& context) {
  Result<gl::Context> gl = openGpu(context);
  if (!gl) return tl::unexpected<Error>(gl.error());
  Result<std::unique_ptr<scene::Renderer>> renderer = scene::Renderer::create(*gl, world);
  if (!renderer) return tl::unexpected<Error>(renderer.error());
  (*renderer)->measure(true);
  constexpr int kWarmUp = 1, kMeasured = 3;
  std::map<std::string, double> milliseconds;
  const int frames = (*renderer)->path().frames();
  for (int i = 0; i < kWarmUp + kMeasured; ++i) {
    const Result<scene::Picture> picture = (*renderer)->render(i * frames / (kWarmUp + kMeasured));
    if (!picture) return tl::unexpected<Error>(picture.error());
    if (i < kWarmUp) continue;
    for (const scene::FrameCost::Pass& pass : (*renderer)->lastCost().passes) {
      milliseconds[pass.name] += pass.milliseconds / kMeasured;
    }
  }
  const scene::SceneDescription& description = world->description;
  fmt::print("scene {}: {}x{}, {} frames in {:.1f} s, GSD {:.1f} cm\n", description.name,
             description.camera.width, description.camera.height, frames, (*renderer)->path().duration(),
             100 * (*renderer)->path().gsd());
  fmt::print("on {}\n\n{:<18} {:<24} {:>9}  {}\n", gl->info().renderer, "node", "kind", "ms/frame", "what");
  for (const scene::GraphNode& node : scene::compileGraph(description.effects)) {
    const auto cost = milliseconds.find(node.name);
    fmt::print("{:<18} {:<24} {:>9}  {}\n", node.name, scene::nameOf(node.kind),
               cost == milliseconds.end() ? "-" : fmt::format("{:.1f}", cost->second), node.meaning);
  }
  const scene::FrameCost& cost = (*renderer)->lastCost();
  fmt::print("\nlast frame: {} passes, {} draws, {} triangles, {} plants\n", cost.passes.size(), cost.draws,
             cost.triangles, cost.plants);
  return kOk;
}

Result<int> record(const Options& options, const std::shared_ptr<const scene::World>& world,
                   const Context& context) {
  std::unique_ptr<Progress> progress;
  const auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  scene::RecordOptions recording;
  recording.live = options.live;
  recording.gpu = gl::optionsFrom(loaded->settings.gpu);
  recording.progress = [&](std::size_t done, std::size_t total, const std::string& frame) {
    if (!progress) progress = std::make_unique<Progress>("rendering frames", total);
    progress->update(done, frame);
  };
  const Result<scene::RecordedScene> recorded = scene::recordScene(world, options.record, recording);
  progress.reset();
  if (!recorded) return tl::unexpected<Error>(recorded.error());
  const std::size_t frames = recorded->plan.frames.size();
  const double share = recorded->duration_s > 0 ? recorded->wall_s / recorded->duration_s : 0;
  if (context.json) {
    nlohmann::json json{{"scene", world->description.name},
                        {"frames", frames},
                        {"flight_s", recorded->duration_s},
                        {"wall_s", recorded->wall_s}};
    if (!options.record.empty()) json["folder"] = options.record;
    if (options.live) json["worst_late_s"] = recorded->worst_late_s;
    fmt::print("{}\n", json.dump(2));
    return kOk;
  }
  if (!options.record.empty())
    fmt::print("{}: {} frames of {}, exact poses in truth.csv\n", options.record, frames,
               world->description.name);
  fmt::print("a flight of {:.1f} s, made in {:.1f} s ({:.2f} of it)\n", recorded->duration_s,
             recorded->wall_s, share);
  if (options.live) fmt::print("the latest frame came {:.2f} s after its time\n", recorded->worst_late_s);
  return kOk;
}

Result<int> simulate(const Options& options, const Context& context) {
  const Result<std::shared_ptr<const scene::World>> world = load(options);
  if (!world) return tl::unexpected<Error>(world.error());
  if (options.explain) {
    Result<int> explained = explain(*world, context);
    if (!explained || (options.record.empty() && !options.live)) return explained;
  }
  if (!options.record.empty() || options.live) return record(options, *world, context);
  return fail(ErrorCode::BadSettings, "simulate needs --record DIR, --live, or --explain");
}

void build(CLI::App& command, Context& context) {
  auto options = std::make_shared<Options>();
  command
      .add_option("SCENE", options->scene, "scene file, or the name of one that ships: village, city, ...")
      ->required();
  command.add_option("--record", options->record, "folder to write a recorded flight to");
  command.add_flag("--explain", options->explain,
                   "print what the scene's effects compile to, with the cost of each pass");
  command.add_flag("--live", options->live,
                   "at true speed, with times of this machine's clock, and say whether it kept up. To map it "
                   "meanwhile: overflyd --set source.kind=scene --set source.path=SCENE");
  command.add_option("--frames", options->frames, "only the first so many frames")
      ->check(CLI::PositiveNumber);
  context.onRun(command, [options, &context] { return simulate(*options, context); });
}

const Registered registered{"simulate", "makes a flight whose every height and colour is known", build};

}  // namespace
}  // namespace overfly::cli
