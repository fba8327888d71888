#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <thread>

#include "daemon/cli/command.h"
#include "daemon/cli/gpu.h"
#include "daemon/cli/progress.h"
#include "daemon/tradeoff/adjust_trials.h"
#include "daemon/tradeoff/codec_trials.h"
#include "daemon/tradeoff/flight_reference.h"
#include "daemon/tradeoff/precision_trials.h"
#include "daemon/tradeoff/preview_trials.h"
#include "daemon/tradeoff/report.h"
#include "daemon/tradeoff/sweep_trials.h"
#include "tiling/mapping/mapper_settings.h"

namespace overfly::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::vector<std::string> flights, scenes;
  std::string output, table;
  int repeats = 0, frames = 0;
  bool quick = false, sweep_only = false, points_only = false;
};

constexpr std::size_t kTruthPoints = 4000;

// A folder for simulated flights that is removed at the end.
class ScratchFolder {
 public:
  ScratchFolder()
      : path_(fs::temp_directory_path() / fmt::format("overfly-bench-{}", static_cast<long>(getpid()))) {
    fs::create_directories(path_);
  }
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

class Steps {
 public:
  explicit Steps(std::string label) : label_(std::move(label)) {}
  void operator()(std::size_t done, std::size_t total, const std::string& note) {
    if (!progress_) progress_ = std::make_unique<Progress>(label_, total);
    progress_->update(done, note);
  }

 private:
  std::string label_;
  std::unique_ptr<Progress> progress_;
};

void append(std::vector<tradeoff::Trial>& to, std::vector<tradeoff::Trial> from) {
  to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
}

std::string commandOf(const Arguments& a) {
  std::string command = "overfly bench tradeoff";
  for (const std::string& flight : a.flights) command += " --flight " + fs::path(flight).filename().string();
  for (const std::string& scene : a.scenes) command += " --scene " + scene;
  if (a.quick) command += " --quick";
  if (a.sweep_only) command += " --sweep-only";
  if (a.points_only) command += " --points-only";
  if (a.repeats > 0) command += fmt::format(" --repeats {}", a.repeats);
  if (a.frames > 0) command += fmt::format(" --frames {}", a.frames);
  return command + " -o " + fs::path(a.output).filename().string();
}

Result<int> tradeoffReport(const Arguments& a, const Context& context) {
  if (a.flights.empty() && a.scenes.empty())
    return fail(ErrorCode::BadSettings, "name at least one --flight DIR or --scene NAME to measure on");
  const int repeats = a.repeats > 0 ? a.repeats : a.quick ? 1 : 3;
  auto gl_context = openGpu(context);
  if (!gl_context) return tl::unexpected(gl_context.error());
  auto settings = tradeoff::sweepSettings(a.quick);
  const bool sweep_only = a.sweep_only || a.points_only;
  if (a.points_only) std::erase_if(settings, [](const auto& setting) { return !setting.point; });
  const ScratchFolder scratch;
  tradeoff::Report report;
  report.command = commandOf(a);
  report.machine = {{"device", gl_context->info().renderer},
                    {"driver", gl_context->info().version},
                    {"processors", std::to_string(std::thread::hardware_concurrency())},
                    {"repeats", fmt::format("{}, after one run to warm up", repeats)}};
  std::vector<std::vector<daemon::OperatingPoint>> points;  // by flight, and by scene where no flight is

  const auto sweepOn = [&](tradeoff::FlightReference reference) -> Result<tradeoff::ReportSection*> {
    Steps steps("sweep of " + reference.name);
    auto swept = tradeoff::trySweep(*gl_context, reference, settings, repeats, std::ref(steps));
    if (!swept) return tl::unexpected(swept.error());
    if (a.flights.empty() || points.size() < a.flights.size()) points.push_back(std::move(swept->points));
    report.sections.push_back({reference.name, reference.reference, std::move(swept->trials)});
    // What is done is not lost if something after it fails.
    if (auto written = tradeoff::writeReport(report, a.output); !written)
      return tl::unexpected(written.error());
    return &report.sections.back();
  };
  for (const std::string& folder : a.flights) {
    auto reference = tradeoff::recordedReference(folder);
    if (!reference) return tl::unexpected(reference.error());
    const capture::Flight flight = reference->flight;
    auto section = sweepOn(std::move(*reference));
    if (!section) return tl::unexpected(section.error());
    if (sweep_only) continue;
    Steps steps("adjustment");
    auto adjusted = tradeoff::tryAdjustment(folder, a.quick, std::ref(steps));
    if (adjusted)
      append((*section)->trials, std::move(*adjusted));
    else if (adjusted.error().code != ErrorCode::NotFound)
      return tl::unexpected(adjusted.error());
    // At the default settings: what the codecs and the preview are tried on.
    tiling::BatchOptions mapping;
    mapping.mapper = tiling::mapperOptions({});
    auto map = tiling::mapFlightToTiles(*gl_context, flight, mapping);
    if (!map) return tl::unexpected(map.error());
    auto coded = tradeoff::tryCodecs(map->tiles, repeats);
    if (!coded) return tl::unexpected(coded.error());
    append((*section)->trials, std::move(*coded));
    auto drawn = tradeoff::tryPreview(*gl_context, map->tiles, map->result.ground, mapping.mapper.tile_size,
                                      scratch.path() / (fs::path(folder).filename().string() + ".overfly"),
                                      a.quick ? 640 : 1280, repeats);
    if (!drawn) return tl::unexpected(drawn.error());
    append((*section)->trials, std::move(*drawn));
  }
  for (const std::string& scene : a.scenes) {
    auto reference = tradeoff::simulatedReference(scene, scratch.path() / fs::path(scene).stem(),
                                                  a.frames > 0 ? a.frames
                                                  : a.quick    ? 10
                                                               : 0,
                                                  kTruthPoints);
    if (!reference) return tl::unexpected(reference.error());
    if (auto section = sweepOn(std::move(*reference)); !section) return tl::unexpected(section.error());
  }
  if (!sweep_only) {
    auto precise = tradeoff::tryPrecision(*gl_context, repeats);
    if (!precise) return tl::unexpected(precise.error());
    report.sections.push_back({"Arithmetic", "the exact projection, in double", std::move(*precise)});
  }
  if (auto written = tradeoff::writeReport(report, a.output); !written)
    return tl::unexpected(written.error());
  auto table = daemon::OperatingTable::make(tradeoff::combined(points));
  if (!table) return tl::unexpected(table.error());
  if (!a.table.empty()) {
    std::ofstream file(a.table, std::ios::binary);
    file << table->json();
    file.close();
    if (!file) return fail(ErrorCode::Io, a.table + " cannot be written");
  }
  if (context.json) {
    fmt::print("{}", tradeoff::jsonOf(report));
    return kOk;
  }
  for (const tradeoff::ReportSection& section : report.sections) {
    std::vector<const tradeoff::Trial*> front;
    for (const tradeoff::Trial& trial : section.trials)
      if (trial.part == "sweep" && trial.on_front) front.push_back(&trial);
    if (front.empty()) continue;
    std::sort(front.begin(), front.end(),
              [](const auto* x, const auto* y) { return x->processor.median_ms < y->processor.median_ms; });
    fmt::print("{}: {} settings on the front, a factor {:.1f} in time\n", section.name, front.size(),
               front.back()->processor.median_ms / front.front()->processor.median_ms);
    for (const tradeoff::Trial* trial : front)
      fmt::print("  {:<40} {:>8.1f} ms per tile  error {:.3f}{}\n", trial->setting,
                 trial->processor.median_ms, trial->error, trial->processor.noisy() ? "  (noisy)" : "");
  }
  fmt::print("report: {}\n", (fs::path(a.output) / "report.html").string());
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* app = command.add_subcommand("tradeoff", "what accuracy costs in time, as a report with plots");
  app->add_option("--flight", arguments->flights,
                  "folder of a flight with reference_points.csv; may be repeated");
  app->add_option("--scene", arguments->scenes,
                  "scene file or name, measured against its own truth; may be repeated");
  app->add_option("-o,--output", arguments->output, "folder for report.html, tradeoff.csv, tradeoff.json")
      ->required();
  app->add_option("--table", arguments->table,
                  "also write the governor's table of operating points, its errors and times the means over "
                  "all flights, or over the scenes where no flight is given");
  app->add_option("--repeats", arguments->repeats, "runs of every setting; default 3, with --quick 1")
      ->check(CLI::Range(1, 100));
  app->add_option("--frames", arguments->frames, "only the first frames of a scene; 0: all")
      ->check(CLI::Range(0, 100000));
  app->add_flag("--quick", arguments->quick, "fewer settings, one run each");
  app->add_flag("--sweep-only", arguments->sweep_only, "no adjustment, codecs, preview and arithmetic");
  app->add_flag("--points-only", arguments->points_only,
                "only the settings of the sweep that the governor may choose");
  context.onRun(*app, [arguments, &context]() -> Result<int> { return tradeoffReport(*arguments, context); });
  command.require_subcommand(1);
}

const Registered registered{"bench", "measures this machine", build};

}  // namespace
}  // namespace overfly::cli
