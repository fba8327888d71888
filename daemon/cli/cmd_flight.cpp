#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "capture/geo/geodetic.h"
#include "capture/import/import_flight.h"
#include "capture/import/survey.h"
#include "capture/replay/replay_source.h"
#include "daemon/cli/command.h"

namespace overfly::cli {
namespace {

using capture::Flight;
using capture::FlightFrame;
using nlohmann::json;

struct Arguments {
  std::string folder, out, camera;
  bool raw = false;
  double ground = std::nan("");
  double speed = 0;
  std::size_t start = 0;

  [[nodiscard]] capture::ImportOptions import() const {
    capture::ImportOptions options;
    options.raw = raw;
    if (!camera.empty()) options.camera_file = camera;
    return options;
  }
};

void print(const std::string& line) { fmt::print("{}\n", line); }

// JSON text; bytes of file names that are not UTF-8 are replaced.
void printJson(const json& value) { print(value.dump(1, ' ', false, json::error_handler_t::replace)); }

double durationOf(const Flight& flight) {
  if (flight.size() < 2) return 0;
  return 1e-9 *
         static_cast<double>(flight.frames().back().frame.time_ns - flight.frames().front().frame.time_ns);
}

// What stands between this flight and a map, one sentence each.
std::vector<std::string> missing(const Flight& flight) {
  std::vector<std::string> sentences;
  std::size_t poses = 0, attitudes = 0, places = 0, exposures = 0;
  for (const FlightFrame& entry : flight.frames()) {
    poses += entry.frame.pose ? 1 : 0;
    exposures += entry.frame.exposure_ns > 0 ? 1 : 0;
    attitudes +=
        entry.raw && entry.raw->gimbal_yaw && entry.raw->gimbal_pitch && entry.raw->gimbal_roll ? 1 : 0;
    places += entry.raw && entry.raw->lat && entry.raw->lon && entry.raw->altitude_m ? 1 : 0;
  }
  if (flight.size() == 0) sentences.push_back("frames: there are none");
  if (poses < flight.size()) {
    sentences.push_back(
        fmt::format("poses: {} of {} frames have none (recorded position: {}, recorded attitude: {})",
                    flight.size() - poses, flight.size(), places, attitudes));
  }
  if (exposures < flight.size()) {
    sentences.push_back(fmt::format("exposure time: not known for {} frames", flight.size() - exposures));
  }
  if (!flight.info().ground_height_m) sentences.push_back("height of the ground: not known");
  if (flight.info().datum == capture::VerticalDatum::Unknown) {
    sentences.push_back("vertical datum: heights pass through unshifted, and exports name none");
  }
  if (flight.skipped() > 0) sentences.push_back(fmt::format("{} frames were skipped", flight.skipped()));
  return sentences;
}

Result<int> info(const Arguments& arguments, bool as_json) {
  const auto flight = capture::importFlight(arguments.folder, arguments.import());
  if (!flight) return tl::unexpected(flight.error());
  const auto& about = flight->info();
  const auto survey = capture::surveyFlight(
      *flight, std::isnan(arguments.ground) ? std::nullopt : std::optional<double>(arguments.ground));
  const double duration = durationOf(*flight);
  std::vector<std::string> lacks = missing(*flight);
  if (!survey)
    lacks.push_back("footprints: " + survey.error().message);
  else if (!survey->refused.empty()) {
    lacks.push_back(fmt::format("footprints: {} frames have none; the first: {}", survey->refused.size(),
                                survey->refused.front()));
  }
  std::size_t adjusted = 0, posed = 0;
  for (const FlightFrame& entry : flight->frames()) {
    posed += entry.frame.pose ? 1 : 0;
    adjusted += entry.frame.pose_is_adjusted ? 1 : 0;
  }

  if (as_json) {
    json out = {{"source", about.source},
                {"frames", flight->size()},
                {"duration_s", duration},
                {"poses", posed},
                {"poses_adjusted", adjusted},
                {"datum", capture::nameOf(about.datum)},
                {"datum_reason", about.datum_reason},
                {"skipped", flight->skipped()},
                {"notes", about.notes},
                {"missing", lacks},
                {"warnings", flight->warnings()},
                {"cameras", json::array()}};
    for (const auto& [id, revision, model] : flight->cameras()) {
      out["cameras"].push_back({{"id", id},
                                {"revision", revision},
                                {"kind", capture::nameOf(model.kind)},
                                {"width", model.width},
                                {"height", model.height},
                                {"fx", model.fx},
                                {"fy", model.fy},
                                {"cx", model.cx},
                                {"cy", model.cy},
                                {"distortion", model.distortion}});
    }
    if (survey) {
      out["ground_height_m"] = survey->ground_height_m;
      out["gsd_m"] = survey->gsd_m;
      out["area_m2"] = survey->area_m2;
      out["area_seen_by_3_m2"] = survey->area3_m2;
      out["mean_overlap_frames"] = survey->mean_overlap;
      out["strips"] = survey->strips;
      if (survey->forward_overlap) out["forward_overlap"] = *survey->forward_overlap;
      if (survey->sideways_overlap) out["sideways_overlap"] = *survey->sideways_overlap;
    }
    printJson(out);
    return kOk;
  }

  const auto row = [](const char* name, const std::string& value) { fmt::print("{:<20}{}\n", name, value); };
  row("flight", about.source.empty() ? arguments.folder : about.source);
  row("frames", fmt::format("{} ({} with pose, {} of them adjusted)", flight->size(), posed, adjusted));
  row("duration", flight->size() > 1 ? fmt::format("{:.1f} s, one frame per {:.2f} s", duration,
                                                   duration / static_cast<double>(flight->size() - 1))
                                     : "one moment");
  for (const auto& [id, revision, model] : flight->cameras()) {
    row(fmt::format("camera {}{}", id, revision > 0 ? fmt::format(" #{}", revision) : "").c_str(),
        fmt::format("{}x{}, {}, f = {:.1f} px", model.width, model.height, capture::nameOf(model.kind),
                    model.fx));
  }
  if (survey) {
    row("ground", fmt::format("{:.2f} m ({})", survey->ground_height_m, survey->ground_reason));
    row("GSD", fmt::format("{:.2f} cm", 100 * survey->gsd_m));
    row("area",
        fmt::format("{:.0f} m2, {:.0f} m2 seen by 3 frames or more", survey->area_m2, survey->area3_m2));
    const auto share = [](const std::optional<double>& value) {
      return value ? fmt::format("{:.0f} %", 100 * *value) : std::string("none");
    };
    row("overlap", fmt::format("forward {}, sideways {}, {:.1f} frames over a point, {} strips",
                               share(survey->forward_overlap), share(survey->sideways_overlap),
                               survey->mean_overlap, survey->strips));
  }
  row("datum", fmt::format("{} ({})", capture::nameOf(about.datum), about.datum_reason));
  for (const std::string& note : about.notes) row("note", note);
  for (const std::string& sentence : lacks) row("missing", sentence);
  for (const std::string& warning : flight->warnings()) row("warning", warning);
  return kOk;
}

std::string utcOf(const capture::Frame& frame) {
  const std::int64_t utc_ns = frame.time_ns + frame.utc_offset_ns;
  const auto second = static_cast<std::time_t>(utc_ns / 1'000'000'000);
  return fmt::format("{:%Y-%m-%d %H:%M:%S}.{:03}", fmt::gmtime(second), utc_ns / 1'000'000 % 1000);
}

constexpr const char* kTableHead =
    "     #  name                  time (UTC)                    latitude    longitude    height     yaw   "
    "pitch  size";

std::string tableRow(const capture::Frame& frame) {
  std::string pose = fmt::format("{:>11} {:>12} {:>9} {:>7} {:>7}", "-", "-", "-", "-", "-");
  if (frame.pose) {
    const geo::Geodetic place = geo::geodeticFromEcef(frame.pose->position_in_ecef);
    const Eigen::Quaterniond enu_from_ecef(geo::LocalFrame(place).enuFromEcefRotation());
    const Eigen::Quaterniond enu_from_camera = enu_from_ecef * frame.pose->ecef_from_camera;
    const Eigen::Vector3d forward = enu_from_camera * Eigen::Vector3d::UnitZ();
    // Straight down the image's top points ahead, level the view itself, between them both do: their sum is
    // never without a direction there, as yaw and roll are at nadir.
    const Eigen::Vector3d ahead = forward - enu_from_camera * Eigen::Vector3d::UnitY();
    const double heading_deg = std::fmod(geo::degrees(std::atan2(ahead.x(), ahead.y())) + 360, 360);
    const double tilt_deg = geo::degrees(std::acos(std::clamp(-forward.z(), -1.0, 1.0)));
    pose = fmt::format("{:>11.7f} {:>12.7f} {:>9.2f} {:>7.1f} {:>7.1f}", geo::degrees(place.lat),
                       geo::degrees(place.lon), place.height_m, heading_deg, tilt_deg);
  }
  return fmt::format("{:>6}  {:<20}  {}  {}  {}x{}", frame.sequence, frame.name, utcOf(frame), pose,
                     frame.image.width, frame.image.height);
}

json jsonOf(const capture::Frame& frame) {
  json out = {{"sequence", frame.sequence},   {"name", frame.name},
              {"camera", frame.camera_id},    {"time_ns", frame.time_ns},
              {"utc", utcOf(frame)},          {"width", frame.image.width},
              {"height", frame.image.height}, {"adjusted", frame.pose_is_adjusted}};
  if (frame.pose) {
    const geo::Geodetic place = geo::geodeticFromEcef(frame.pose->position_in_ecef);
    out["lat_deg"] = geo::degrees(place.lat);
    out["lon_deg"] = geo::degrees(place.lon);
    out["height_m"] = place.height_m;
  }
  return out;
}

Result<int> frames(const Arguments& arguments, bool as_json) {
  const auto flight = capture::importFlight(arguments.folder, arguments.import());
  if (!flight) return tl::unexpected(flight.error());
  if (as_json) {
    json out = json::array();
    for (const FlightFrame& entry : flight->frames()) out.push_back(jsonOf(entry.frame));
    printJson(out);
    return kOk;
  }
  print(kTableHead);
  for (const FlightFrame& entry : flight->frames()) print(tableRow(entry.frame));
  return kOk;
}

Result<int> import(const Arguments& arguments) {
  const auto flight = capture::importFlight(arguments.folder, arguments.import());
  if (!flight) return tl::unexpected(flight.error());
  const auto saved = capture::saveFlight(*flight, arguments.out);
  if (!saved) return tl::unexpected(saved.error());
  for (const std::string& warning : saved->warnings()) fmt::print(stderr, "overfly: {}\n", warning);
  print(fmt::format("{} frames in {}, {} skipped", saved->size(), arguments.out, saved->skipped()));
  print(fmt::format("vertical datum: {} ({})", capture::nameOf(saved->info().datum),
                    saved->info().datum_reason));
  for (const std::string& note : saved->info().notes) print("note: " + note);
  return saved->size() > 0 ? kOk : kFailed;
}

Result<int> play(const Arguments& arguments) {
  capture::ReplayOptions options;
  options.speed = arguments.speed;
  options.start = arguments.start;
  options.import = arguments.import();
  capture::ReplaySource source(std::filesystem::path(arguments.folder), options);
  if (auto opened = source.open(); !opened) return tl::unexpected(opened.error());
  print(kTableHead);
  std::size_t good = 0, bad = 0;
  for (;;) {
    const auto frame = source.next(std::chrono::seconds(1));
    if (!frame && frame.error().code == ErrorCode::Unavailable) continue;  // the next is not due yet
    if (!frame) {
      ++bad;
      fmt::print(stderr, "overfly: {}\n", frame.error().message);
      continue;
    }
    if (!*frame) break;
    ++good;
    print(tableRow(**frame));
    std::fflush(stdout);
  }
  print(fmt::format("{} frames played from {}, {} unreadable", good, source.describe(), bad));
  return good > 0 ? kOk : kFailed;
}

void build(CLI::App& command, Context& context) {
  const auto add = [&](const char* name, const char* summary, auto action) {
    auto arguments = std::make_shared<Arguments>();
    CLI::App* sub = command.add_subcommand(name, summary);
    sub->add_option(
           "DIR", arguments->folder,
           "a recorded flight, a folder with flight.csv, or a folder of drone JPEGs; never written to")
        ->required();
    sub->add_flag("--raw", arguments->raw,
                  "take what the drone recorded instead of adjusted poses (flight.csv)");
    sub->add_option("--camera", arguments->camera, "camera file to use instead of what the folder says");
    context.onRun(
        *sub, [arguments, action, &context]() -> Result<int> { return action(*arguments, context.json); });
    return std::pair(sub, arguments);
  };
  command.require_subcommand(1);
  const auto [info_command, info_arguments] =
      add("info", "prints what a flight holds and what it lacks", info);
  info_command->add_option("--ground", info_arguments->ground,
                           "height of the ground in the flight's datum, metres");
  add("frames", "prints the table of the frames", frames);
  const auto [import_command, import_arguments] = add("import", "makes a recorded flight of a folder",
                                                      [](const Arguments& a, bool) { return import(a); });
  import_command->add_option("-o,--out", import_arguments->out, "new folder for the recorded flight")
      ->required();
  const auto [play_command, play_arguments] =
      add("play", "plays a flight through the mock camera and prints its frames",
          [](const Arguments& a, bool) { return play(a); });
  play_command
      ->add_option("--speed", play_arguments->speed, "times true time; 0 (default): as fast as it goes")
      ->check(CLI::NonNegativeNumber);
  play_command->add_option("--start", play_arguments->start, "number of the first frame");
}

const Registered registered{"flight", "recorded flights: import, look at, play", build};

}  // namespace
}  // namespace overfly::cli
