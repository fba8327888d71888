// The same frames, with the same nominal lens and the same recorded positions, through `overfly adjust`'s own
// code and through COLMAP's command line (Debian: colmap; extraction on the processor, spatial matching,
// mapper; else its defaults): time per frame, residuals, and what became of poses, lens and ground.
#include <benchmark/benchmark.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "capture/geo/geodetic.h"
#include "tests/accuracy/adjust/run_recorded.h"

namespace overfly::tiling::adjust {
namespace {

struct Recording {
  const char* folder;
  double focal_mm, pixel_um_at_4000;  // as printed on lens and sensor
};
constexpr Recording kRecordings[] = {{"brighton-beach", 3.61, 1.55}, {"caliterra", 4.5, 1.545}};

double processorSeconds(int who) {
  rusage usage{};
  getrusage(who, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

double wallSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// A folder that goes away again.
struct Scratch {
  std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("overfly-colmap." + std::to_string(getpid()));
  Scratch() {
    std::filesystem::remove_all(path);
    std::filesystem::create_directories(path / "sparse");
  }
  ~Scratch() { std::filesystem::remove_all(path); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
};

// What the spatial matcher goes by: the recorded positions, which the pictures' stripped EXIF no longer has.
bool writePositions(const std::filesystem::path& database, const RecordedFlight& flight) {
  sqlite3* raw = nullptr;
  const bool open = sqlite3_open(database.c_str(), &raw) == SQLITE_OK;
  const std::unique_ptr<sqlite3, decltype(&sqlite3_close)> db(raw, sqlite3_close);
  if (!open) return false;
  for (const auto& frame : flight.frames) {
    if (!frame.raw->lat || !frame.raw->lon) continue;
    const std::string change = fmt::format(
        "UPDATE images SET prior_tx = {:.9f}, prior_ty = {:.9f}, prior_tz = {:.3f} WHERE name = '{}'",
        geo::degrees(*frame.raw->lat), geo::degrees(*frame.raw->lon), frame.raw->altitude_m.value_or(0),
        frame.frame.name);
    if (sqlite3_exec(db.get(), change.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) return false;
  }
  return true;
}

struct ColmapModel {
  capture::CameraModel lens;
  std::vector<std::optional<View>> views;  // by index of the flight's frame, in COLMAP's own frame
  std::size_t observations = 0, points = 0;
  double rms_px = 0;  // root mean square length of the re-projection residuals
};

// cameras.txt, images.txt, points3D.txt of `colmap model_converter --output_type TXT`. COLMAP counts pixels
// as we do (first pixel's centre at (0.5, 0.5)).
ColmapModel readModel(const std::filesystem::path& folder, const RecordedFlight& flight) {
  ColmapModel out;
  out.views.resize(flight.frames.size());
  const auto lines = [](const std::filesystem::path& file) {
    std::vector<std::string> kept;
    std::ifstream in(file);
    for (std::string line; std::getline(in, line);)
      if (line.empty() || line[0] != '#') kept.push_back(line);
    return kept;
  };
  for (const auto& line : lines(folder / "cameras.txt")) {
    std::istringstream in(line);
    std::string id, model;
    auto& c = out.lens;
    c.kind = capture::CameraModel::Kind::RadialTangential;
    c.distortion.resize(4);
    in >> id >> model >> c.width >> c.height >> c.fx >> c.fy >> c.cx >> c.cy;
    for (double& d : c.distortion) in >> d;
  }
  std::map<long, Eigen::Vector3d> points;
  for (const auto& line : lines(folder / "points3D.txt")) {
    std::istringstream in(line);
    long id = 0;
    Eigen::Vector3d p;
    in >> id >> p.x() >> p.y() >> p.z();
    points[id] = p;
  }
  out.points = points.size();
  std::map<std::string, std::size_t> index;
  for (std::size_t i = 0; i < flight.frames.size(); ++i) index[flight.frames[i].frame.name] = i;
  const auto images = lines(folder / "images.txt");
  double squares = 0;
  for (std::size_t i = 0; i + 1 < images.size(); i += 2) {
    std::istringstream pose(images[i]), seen(images[i + 1]);
    std::string id, camera, name;
    Eigen::Quaterniond camera_from_world;
    Eigen::Vector3d shift;
    pose >> id >> camera_from_world.w() >> camera_from_world.x() >> camera_from_world.y() >>
        camera_from_world.z() >> shift.x() >> shift.y() >> shift.z() >> camera >> name;
    out.views[index.at(name)] = View{-(camera_from_world.conjugate() * shift), camera_from_world.conjugate()};
    double x = 0, y = 0;
    long point = 0;
    while (seen >> x >> y >> point) {
      if (point < 0) continue;
      const auto px = out.lens.project(camera_from_world * points.at(point) + shift);
      if (!px) continue;
      squares += (*px - Eigen::Vector2d(x, y)).squaredNorm();
      ++out.observations;
    }
  }
  out.rms_px = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, out.observations)));
  return out;
}

void overfly(benchmark::State& state) {
  const Recording& recording = kRecordings[state.range(0)];
  const auto flight = RecordedFlight::read(std::string(OVERFLY_FLIGHTS_DIR "/") + recording.folder);
  const auto n = static_cast<double>(flight.frames.size());
  for (auto _ : state) {
    const double before = processorSeconds(RUSAGE_SELF);
    const Outcome out = run(flight, flight.nominal(recording.focal_mm, recording.pixel_um_at_4000), false);
    state.counters["cpu_s/frame"] = (processorSeconds(RUSAGE_SELF) - before) / n;
    state.counters["s/frame"] = out.total_s / n;
    state.counters["live_s/frame"] = out.live_s / n;
    state.counters["frames"] = out.adjusted;
    state.counters["observations"] = out.summary.observations;
    state.counters["rms_px"] = out.summary.rms_px;
    state.counters["position_mm"] = 1000 * out.position_rms_m;
    state.counters["worst_mm"] = 1000 * out.worst_position_m;
    state.counters["rotation_deg"] = out.rotation_rms_deg;
    state.counters["focal_px"] = out.summary.shared.lens[0];
    state.counters["dome_mm"] = 1000 * out.ground.dome_rms_m;
  }
}

void colmap(benchmark::State& state) {
  if (std::system("command -v colmap >/dev/null") != 0)
    return state.SkipWithError("colmap is not installed (Debian: colmap)");
  const Recording& recording = kRecordings[state.range(0)];
  const auto flight = RecordedFlight::read(std::string(OVERFLY_FLIGHTS_DIR "/") + recording.folder);
  const capture::CameraModel lens = flight.nominal(recording.focal_mm, recording.pixel_um_at_4000);
  const auto n = static_cast<double>(flight.frames.size());
  const Scratch scratch;
  const std::string at = scratch.path.string(), database = " --database_path " + at + "/db";
  const std::string images = " --image_path " +
                             std::filesystem::path(flight.frames.front().file).parent_path().string() +
                             " --image_list_path " + at + "/list";
  {
    std::ofstream list(scratch.path / "list");
    for (const auto& frame : flight.frames) list << frame.frame.name << '\n';
  }
  const auto timed = [&](const std::string& command, double& seconds) {
    const double start = wallSeconds();
    const int status =
        std::system(("QT_QPA_PLATFORM=offscreen colmap " + command + " >" + at + "/log 2>&1").c_str());
    seconds = wallSeconds() - start;
    return status == 0;
  };
  for (auto _ : state) {
    const double before = processorSeconds(RUSAGE_CHILDREN);
    double extract_s = 0, match_s = 0, map_s = 0, convert_s = 0;
    const bool done = timed("feature_extractor" + database + images + " --SiftExtraction.use_gpu 0" +
                                fmt::format(" --ImageReader.single_camera 1 --ImageReader.camera_model OPENCV"
                                            " --ImageReader.camera_params {},{},{},{},0,0,0,0",
                                            lens.fx, lens.fy, lens.cx, lens.cy),
                            extract_s) &&
                      writePositions(scratch.path / "db", flight) &&
                      timed("spatial_matcher" + database + " --SiftMatching.use_gpu 0", match_s) &&
                      timed("mapper" + database + images + " --output_path " + at + "/sparse", map_s);
    const double cpu_s = processorSeconds(RUSAGE_CHILDREN) - before;
    if (!done ||
        !timed("model_converter --output_type TXT --input_path " + at + "/sparse/0 --output_path " + at,
               convert_s)) {
      std::ifstream log(scratch.path / "log");
      const std::string said((std::istreambuf_iterator<char>(log)), {});
      return state.SkipWithError(("colmap failed: " + said.substr(0, 400)).c_str());
    }
    const ColmapModel model = readModel(scratch.path, flight);
    std::vector<Eigen::Vector3d> got, wanted;
    std::vector<Eigen::Quaterniond> got_q, wanted_q;
    for (std::size_t i = 0; i < model.views.size(); ++i) {
      if (!model.views[i]) continue;
      got.push_back(model.views[i]->position);
      got_q.push_back(model.views[i]->world_from_camera);
      wanted.push_back(flight.reference[i].position);
      wanted_q.push_back(flight.reference[i].enu_from_camera);
    }
    const auto poses = tests::againstReference(got, got_q, wanted, wanted_q, verbose());
    const auto ground = tests::retriangulate(flight, model.lens, model.views);
    state.counters["cpu_s/frame"] = cpu_s / n;
    state.counters["s/frame"] = (extract_s + match_s + map_s) / n;
    state.counters["extract_s"] = extract_s;
    state.counters["match_s"] = match_s;
    state.counters["map_s"] = map_s;
    state.counters["frames"] = static_cast<double>(got.size());
    state.counters["observations"] = static_cast<double>(model.observations);
    state.counters["rms_px"] = model.rms_px;
    state.counters["position_mm"] = 1000 * poses.position_rms_m;
    state.counters["worst_mm"] = 1000 * poses.worst_position_m;
    state.counters["rotation_deg"] = poses.rotation_rms_deg;
    state.counters["focal_px"] = model.lens.fx;
    state.counters["dome_mm"] = 1000 * ground.dome_rms_m;
  }
}

// Argument: index of the recording.
BENCHMARK(overfly)
    ->Name("poses/overfly")
    ->Arg(0)
    ->Arg(1)
    ->Iterations(1)
    ->Unit(benchmark::kSecond)
    ->UseRealTime();
BENCHMARK(colmap)
    ->Name("poses/colmap")
    ->Arg(0)
    ->Arg(1)
    ->Iterations(1)
    ->Unit(benchmark::kSecond)
    ->UseRealTime();

}  // namespace
}  // namespace overfly::tiling::adjust
