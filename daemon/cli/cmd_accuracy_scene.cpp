#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "capture/import/import_flight.h"
#include "daemon/cli/progress.h"
#include "daemon/cli/scene_accuracy.h"
#include "render/gl/gpu_options.h"
#include "render/scene/record_scene.h"
#include "tiling/accuracy/truth_comparison.h"

namespace overfly::cli {
namespace {

// A folder of its own that goes with the object.
class ScratchFolder {
 public:
  ScratchFolder()
      : path_(std::filesystem::temp_directory_path() / fmt::format("overfly-accuracy-{}", getpid())) {}
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

struct EffectSet {
  std::string name;
  std::vector<scene::EffectSettings> effects;
};

Result<std::vector<EffectSet>> effectSets(const SceneAccuracyOptions& options,
                                          const scene::SceneDescription& description) {
  std::vector<scene::EffectSettings> effects = description.effects;
  if (!options.effects.empty()) {
    effects.clear();
    std::stringstream names(options.effects == "none" ? "" : options.effects);
    for (std::string name; std::getline(names, name, ',');) {
      const auto effect = scene::effectNamed(name);
      if (!effect) {
        std::string known;
        for (const scene::EffectInfo& info : scene::allEffects())
          known += (known.empty() ? "" : ", ") + std::string(info.name);
        return fail(ErrorCode::BadSettings,
                    fmt::format("--effects: there is no effect {}; there are {}", name, known));
      }
      const auto* own = scene::findEffect(description.effects, *effect);
      effects.push_back(own != nullptr ? *own : scene::defaultSettings(*effect, description.seed));
    }
  }
  const auto nameOf = [](const std::vector<scene::EffectSettings>& set) {
    std::string name;
    for (const scene::EffectSettings& one : set)
      name += (name.empty() ? "" : ", ") + std::string(scene::infoOf(one.effect).name);
    return name.empty() ? std::string("none") : name;
  };
  std::vector<EffectSet> sets{{nameOf(effects), effects}};
  if (!options.each_effect) return sets;
  if (effects.size() > 1)
    for (const scene::EffectSettings& left_out : effects) {
      std::vector<scene::EffectSettings> set;
      for (const scene::EffectSettings& one : effects)
        if (one.effect != left_out.effect) set.push_back(one);
      sets.push_back({nameOf(set), set});
    }
  if (!effects.empty()) sets.push_back({"none", {}});
  return sets;
}

struct Row {
  std::string effects;
  tiling::TruthComparison comparison;
  tiling::MapGround ground;
  std::size_t tiles = 0;
  std::uint64_t frames = 0;
  double render_s = 0, map_s = 0;
};

Result<Row> measure(scene::SceneDescription description, const EffectSet& set,
                    const tiling::BatchOptions& mapping, const gl::ContextOptions& gpu) {
  description.effects = set.effects;
  auto world = scene::buildWorld(description);
  if (!world) return tl::unexpected(world.error());
  const ScratchFolder scratch;
  StageProgress show(fmt::format("{} ({}): ", description.name, set.name));
  scene::RecordOptions recording;
  recording.gpu = gpu;
  recording.progress = [&](std::size_t done, std::size_t total, const std::string&) {
    show("rendering frames", done, total);
  };
  auto recorded = scene::recordScene(*world, scratch.path(), recording);
  if (!recorded) return tl::unexpected(recorded.error());
  auto flight = capture::importFlight(scratch.path());
  if (!flight) return tl::unexpected(flight.error());
  auto context = gl::Context::create(gpu);
  if (!context) return tl::unexpected(context.error());
  auto made = tiling::mapFlightToTiles(*context, *flight, mapping,
                                       [&](const std::string& name, std::uint64_t done, std::uint64_t total) {
                                         show("mapping " + name, done, total);
                                       });
  if (!made) return tl::unexpected(made.error());
  const auto& [mapped, tiles] = *made;
  const scene::Truth truth(*world);
  const tiling::MapGround& ground = mapped.ground;
  Row row;
  row.effects = set.name;
  row.comparison =
      tiling::compareWithTruth(tiles, {ground.lattice, ground.base_zoom, ground.gsd_m, ground.texel_m}, truth,
                               recorded->plan, recorded->camera);
  row.ground = ground;
  row.tiles = tiles.size();
  row.frames = mapped.frames_used;
  row.render_s = recorded->wall_s;
  row.map_s = mapped.wall_s;
  return row;
}

nlohmann::json asJson(const tiling::ErrorStatistics& s) {
  return {{"texels", s.points}, {"complete", s.complete},       {"median_gsd", s.median},
          {"nmad_gsd", s.nmad}, {"rmse_gsd", s.rmse},           {"p90_gsd", s.p90},
          {"p99_gsd", s.p99},   {"beyond_10_gsd", s.beyond_10}, {"beyond_5_gsd", s.beyond_5}};
}

nlohmann::json asJson(const Row& row) {
  const tiling::TruthComparison& c = row.comparison;
  return {{"effects", row.effects},
          {"frames", row.frames},
          {"tiles", row.tiles},
          {"gsd_m", row.ground.gsd_m},
          {"all", asJson(c.all)},
          {"ground", asJson(c.ground)},
          {"solids", asJson(c.solids)},
          {"plants", asJson(c.plants)},
          {"seen", asJson(c.seen)},
          {"hidden", asJson(c.hidden)},
          {"colour",
           {{"texels", c.colour.texels},
            {"median", c.colour.median},
            {"p95", c.colour.p95},
            {"beyond_32", c.colour.beyond_32}}},
          {"render_s", row.render_s},
          {"map_s", row.map_s}};
}

void print(const Row& row) {
  const auto line = [](const char* what, const tiling::ErrorStatistics& s) {
    if (s.points == 0) return;
    fmt::print("  {:<8} {:>8} {:>9.4f} {:>+8.3f} {:>7.3f} {:>8.3f} {:>7.2f} {:>8.2f} {:>8.4f} {:>8.4f}\n",
               what, s.points, s.complete, s.median, s.nmad, s.rmse, s.p90, s.p99, s.beyond_5, s.beyond_10);
  };
  const tiling::TruthComparison& c = row.comparison;
  fmt::print("{}: GSD {:.2f} cm, {} tiles from {} frames, rendered in {:.1f} s, mapped in {:.1f} s\n",
             row.effects, 100 * row.ground.gsd_m, row.tiles, row.frames, row.render_s, row.map_s);
  fmt::print("  {:<8} {:>8} {:>9} {:>8} {:>7} {:>8} {:>7} {:>8} {:>8} {:>8}\n", "in GSD", "texels",
             "complete", "median", "NMAD", "RMSE", "p90", "p99", "> 5", "> 10");
  line("all", c.all);
  line("ground", c.ground);
  line("solids", c.solids);
  line("plants", c.plants);
  line("seen", c.seen);
  line("hidden", c.hidden);
  fmt::print("  colour: median {:.1f}, 95th percentile {:.1f} of 255, beyond 32: {:.4f}\n\n", c.colour.median,
             c.colour.p95, c.colour.beyond_32);
}

void printTableRow(const std::string& scene, const Row& row) {
  const tiling::TruthComparison& c = row.comparison;
  fmt::print(
      "| {} | {} | {:.1f} | {:.4f} | {:+.2f} | {:.2f} | {:.1f} | {:.1f} | {:.2f} % | {:.1f} / {:.1f} |\n",
      scene, row.effects, 100 * row.ground.gsd_m, c.all.complete, c.all.median, c.all.nmad, c.all.p90,
      c.all.p99, 100 * c.all.beyond_10, c.colour.median, c.colour.p95);
}

}  // namespace

Result<int> sceneAccuracy(const SceneAccuracyOptions& options, const tiling::BatchOptions& mapping,
                          const Context& context) {
  const auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  const gl::ContextOptions gpu = gl::optionsFrom(loaded->settings.gpu);
  auto description = scene::loadScene(options.scene);
  if (!description) return tl::unexpected(description.error());
  if (options.frames > 0) {
    description->path.frames = std::min(description->path.frames, options.frames);
    description->path.lines = std::min(description->path.lines, description->path.frames);
  }
  if (options.reduce > 1) description->camera = description->camera.scaled(1.0 / options.reduce);
  auto sets = effectSets(options, *description);
  if (!sets) return tl::unexpected(sets.error());
  nlohmann::json rows = nlohmann::json::array();
  for (const EffectSet& set : *sets) {
    auto row = measure(*description, set, mapping, gpu);
    if (!row) return tl::unexpected(row.error());
    if (options.json)
      rows.push_back(asJson(*row));
    else if (options.table)
      printTableRow(description->name, *row);
    else
      print(*row);
  }
  if (options.json)
    fmt::print("{}\n", nlohmann::json{{"scene", description->name},
                                      {"width", description->camera.width},
                                      {"height", description->camera.height},
                                      {"runs", rows}}
                           .dump(2));
  return 0;
}

}  // namespace overfly::cli
