#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <sstream>

#include "daemon/cli/command.h"
#include "daemon/cli/gpu.h"
#include "daemon/cli/progress.h"
#include "render/preview/previewer.h"
#include "tiling/preview/frame_projectors.h"
#include "tiling/preview/store_tile_source.h"

namespace overfly::cli {
namespace {

using preview::Look;
using preview::View;

struct Arguments {
  std::string map, out, from, look, size = "1280x720", at, sun = "315,45", flyover;
  std::string surface = "linear", filter = "anisotropic", mode = "color", no_data = "hole";
  double fov = 60, relief = 0.4;
  int anisotropy = 4, memory_mb = 512, orbit = 0, frames = 100, photos = 0;
  bool shadows = false, finest = false;
};

Result<std::vector<double>> numbers(const std::string& text, const std::string& option, std::size_t count) {
  std::vector<double> out;
  std::stringstream in(text);
  for (std::string part; std::getline(in, part, ',');) {
    std::size_t used = 0;
    double value = NAN;
    try {
      value = std::stod(part, &used);
    } catch (const std::exception&) {
      used = 0;
    }
    if (used == 0 || used != part.size() || !std::isfinite(value))
      return fail(ErrorCode::BadSettings, fmt::format("{}: \"{}\" is not a number", option, part));
    out.push_back(value);
  }
  if (out.size() != count)
    return fail(ErrorCode::BadSettings,
                fmt::format("{} takes {} numbers with commas between them, not \"{}\"", option, count, text));
  return out;
}

template <typename T>
T named(const std::string& name, std::initializer_list<std::pair<const char*, T>> values) {
  for (const auto& [text, value] : values)
    if (name == text) return value;
  return values.begin()->second;  // CLI11 lets only these names through
}

Look lookOf(const Arguments& arguments, const std::vector<double>& sun) {
  Look look;
  look.surface = named<preview::Surface>(arguments.surface, {{"linear", preview::Surface::Linear},
                                                             {"blocks", preview::Surface::Blocks},
                                                             {"bicubic", preview::Surface::Bicubic}});
  look.filter = named<preview::Filter>(arguments.filter, {{"anisotropic", preview::Filter::Anisotropic},
                                                          {"trilinear", preview::Filter::Trilinear},
                                                          {"bilinear", preview::Filter::Bilinear},
                                                          {"nearest", preview::Filter::Nearest}});
  look.mode = named<preview::Mode>(arguments.mode, {{"color", preview::Mode::Color},
                                                    {"elevation", preview::Mode::Elevation},
                                                    {"quality", preview::Mode::Quality},
                                                    {"age", preview::Mode::Age},
                                                    {"level", preview::Mode::Level}});
  look.no_data = arguments.no_data == "patch" ? preview::NoData::Patch : preview::NoData::Hole;
  look.max_anisotropy = arguments.anisotropy;
  look.projectors = arguments.photos;
  look.shadows = arguments.shadows;
  look.relief = arguments.relief;
  look.sun_heading = geo::radians(sun[0]);
  look.sun_height = geo::radians(sun[1]);
  look.level_of_detail = !arguments.finest;
  return look;
}

// All of the map, from the south and above.
View overview(const preview::Domain& domain, double ground_m, double fov) {
  View view;
  const Eigen::Vector2d middle = (domain.minTexel() + domain.maxTexel()) / 2;
  const double across = (domain.maxTexel() - domain.minTexel()).maxCoeff() * domain.texelSize();
  const double away = 0.62 * across / std::tan(fov / 2);
  view.pitch = geo::radians(-40);
  const double south = away * std::cos(view.pitch) / domain.texelSize();
  view.position =
      domain.lattice().geodeticFromPlane(domain.planeFromTexel(middle + Eigen::Vector2d(0, south)));
  view.position.height_m = ground_m + away * std::sin(-view.pitch);
  return view;
}

cv::Mat matrixOf(const preview::Picture& picture) {
  cv::Mat bgr(picture.height, picture.width, CV_8UC3);
  const std::uint8_t* from = picture.rgba.data();
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x, from += 4) bgr.at<cv::Vec3b>(y, x) = {from[2], from[1], from[0]};
  return bgr;
}

constexpr int kJpegQuality = 90;

// One picture into a file of its own, by its ending; or at the end of a .mjpeg file, one JPEG after the
// other.
Result<void> write(const std::filesystem::path& path, const preview::Picture& picture, bool first) {
  const std::vector<int> options{cv::IMWRITE_JPEG_QUALITY, kJpegQuality};
  try {
    if (path.extension() != ".mjpeg") {
      if (cv::imwrite(path.string(), matrixOf(picture), options)) return {};
    } else {
      std::vector<std::uint8_t> jpeg;
      std::ofstream out(path, std::ios::binary | (first ? std::ios::trunc : std::ios::app));
      if (cv::imencode(".jpg", matrixOf(picture), jpeg, options) &&
          out.write(reinterpret_cast<const char*>(jpeg.data()), static_cast<std::streamsize>(jpeg.size())))
        return {};
    }
  } catch (const cv::Exception& error) {
    return fail(ErrorCode::Io, fmt::format("{} cannot be written: {}", path.string(), error.err));
  }
  return fail(ErrorCode::Io, fmt::format("{} cannot be written", path.string()));
}

// out.png becomes out-0007.png.
std::filesystem::path numbered(const std::filesystem::path& path, std::size_t index) {
  std::filesystem::path out = path;
  out.replace_filename(fmt::format("{}-{:04}{}", path.stem().string(), index, path.extension().string()));
  return out;
}

double turn(double from, double to, double share) {  // the short way round
  return from + share * std::remainder(to - from, 2 * std::acos(-1.0));
}

// Around the point that the view looks at, `count` pictures for the full circle.
std::vector<View> orbit(const View& view, double ground_m, int count) {
  const double above = std::max(view.position.height_m - ground_m, 1.0);
  const double away = view.pitch < -0.05 ? above / std::tan(-view.pitch) : 10 * above;
  const geo::LocalFrame frame(view.position);
  geo::Geodetic target = geo::geodeticFromEcef(
      frame.ecefFromEnu({away * std::sin(view.heading), away * std::cos(view.heading), -above}));
  target.height_m = view.position.height_m;
  const geo::LocalFrame around(target);
  std::vector<View> views;
  for (int i = 0; i < count; ++i) {
    View next = view;
    next.heading = view.heading + 2 * std::acos(-1.0) * i / count;
    next.position = geo::geodeticFromEcef(
        around.ecefFromEnu({-away * std::sin(next.heading), -away * std::cos(next.heading), 0}));
    next.position.height_m = view.position.height_m;
    views.push_back(next);
  }
  return views;
}

// Between the lines LAT,LON,HEIGHT,HEADING,PITCH of a file, evenly by the line's number.
Result<std::vector<View>> flyover(const View& view, const std::string& path, int count) {
  std::ifstream in(path);
  if (!in) return fail(ErrorCode::NotFound, fmt::format("{} cannot be read", path));
  std::vector<View> keys;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line.front() == '#') continue;
    const auto values = numbers(line, fmt::format("{}, view point {}", path, keys.size() + 1), 5);
    if (!values) return tl::unexpected(values.error());
    View key = view;
    key.position = {geo::radians((*values)[0]), geo::radians((*values)[1]), (*values)[2]};
    key.heading = geo::radians((*values)[3]);
    key.pitch = geo::radians((*values)[4]);
    keys.push_back(key);
  }
  if (keys.size() < 2)
    return fail(ErrorCode::BadInput, fmt::format("{} needs two view points or more, one a line", path));
  std::vector<View> views;
  for (int i = 0; i < count; ++i) {
    const double at = static_cast<double>(keys.size() - 1) * i / std::max(count - 1, 1);
    const auto k = std::min(static_cast<std::size_t>(at), keys.size() - 2);
    const View &a = keys[k], &b = keys[k + 1];
    const double share = at - static_cast<double>(k);
    View next = a;
    next.position.lat += share * (b.position.lat - a.position.lat);
    next.position.lon = turn(a.position.lon, b.position.lon, share);
    next.position.height_m += share * (b.position.height_m - a.position.height_m);
    next.heading = turn(a.heading, b.heading, share);
    next.pitch += share * (b.pitch - a.pitch);
    views.push_back(next);
  }
  return views;
}

// Many pictures; the report is of all of them.
Result<int> drawSequence(const Context& context, const Arguments& arguments, preview::Previewer& previewer,
                         const std::vector<View>& views, const Look& look) {
  const std::filesystem::path out = arguments.out;
  const auto begin = std::chrono::steady_clock::now();
  Progress progress("drawing", views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto frame = previewer.drawSettled(views[i], look);
    if (!frame) return tl::unexpected(frame.error());
    const auto path = out.extension() == ".mjpeg" ? out : numbered(out, i);
    if (auto written = write(path, frame->picture, i == 0); !written) return tl::unexpected(written.error());
    progress.update(i + 1);
  }
  progress.finish();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const double rate = static_cast<double>(views.size()) / std::max(seconds, 1e-9);
  if (context.json) {
    fmt::print("{}\n",
               nlohmann::json({{"out", arguments.out}, {"pictures", views.size()}, {"fps", rate}}).dump());
  } else {
    fmt::print("{}: {} pictures, {:.2f} a second\n", arguments.out, views.size(), rate);
  }
  return kOk;
}

Result<int> draw(const Context& context, const Arguments& arguments) {
  int width = 0, height = 0;
  char by = 0, rest = 0;
  std::istringstream size(arguments.size);
  if (!(size >> width >> by >> height) || by != 'x' || size >> rest || width < 16 || height < 16 ||
      width > 8192 || height > 8192)
    return fail(ErrorCode::BadSettings, "--size takes WIDTHxHEIGHT, each from 16 to 8192, as in 1280x720");
  const auto sun = numbers(arguments.sun, "--sun", 2);
  if (!sun) return tl::unexpected(sun.error());
  if ((*sun)[1] <= 0 || (*sun)[1] > 90)
    return fail(ErrorCode::BadSettings, "--sun: the sun must stand above the horizon, at most at 90 degrees");

  auto source = tiling::StoreTileSource::open(arguments.map);
  if (!source) return tl::unexpected(source.error());
  auto gl = openGpu(context);
  if (!gl) return tl::unexpected(gl.error());
  preview::RamCache ram(**source, {.budget_bytes = static_cast<std::size_t>(arguments.memory_mb) << 20});
  preview::Previewer previewer(*gl, ram, {.gpu_bytes = static_cast<std::size_t>(arguments.memory_mb) << 20});
  const Look look = lookOf(arguments, *sun);

  View view;
  const auto extent = (*source)->extent();
  if (!extent) return tl::unexpected(extent.error());
  const auto domain = preview::Domain::create(*extent);
  if (!domain) return tl::unexpected(domain.error());
  if (arguments.from.empty()) {
    // The height of the ground is known once something was drawn.
    View probe = overview(*domain, 0, geo::radians(arguments.fov));
    probe.width = probe.height = 16;
    if (const auto drawn = previewer.drawSettled(probe, look); !drawn) return tl::unexpected(drawn.error());
    view = overview(*domain, previewer.cache()->baseHeight(), geo::radians(arguments.fov));
  } else {
    const auto from = numbers(arguments.from, "--from", 3);
    if (!from) return tl::unexpected(from.error());
    if (std::abs((*from)[0]) > 90 || std::abs((*from)[1]) > 360)
      return fail(ErrorCode::BadSettings, "--from takes LAT,LON,HEIGHT in degrees and metres");
    view.position = {geo::radians((*from)[0]), geo::radians((*from)[1]), (*from)[2]};
  }
  if (!arguments.look.empty()) {
    const auto direction = numbers(arguments.look, "--look", 2);
    if (!direction) return tl::unexpected(direction.error());
    if (std::abs((*direction)[1]) > 90)
      return fail(ErrorCode::BadSettings, "--look takes HEADING,PITCH in degrees, the pitch from -90 to 90");
    view.heading = geo::radians((*direction)[0]);
    view.pitch = geo::radians((*direction)[1]);
  }
  view.fov = geo::radians(arguments.fov);
  view.width = width;
  view.height = height;
  if (arguments.photos > 0 || arguments.orbit > 0) {
    // The ground's height: known once something was drawn.
    View probe = view;
    probe.width = probe.height = 16;
    if (const auto drawn = previewer.drawSettled(probe, look); !drawn) return tl::unexpected(drawn.error());
  }
  std::optional<tiling::FrameProjectors> photographs;
  if (arguments.photos > 0) {
    const auto map = tiling::MapReader::open(arguments.map);
    if (!map) return tl::unexpected(map.error());
    auto made = tiling::FrameProjectors::create(*map, arguments.map, previewer.cache()->baseHeight());
    if (!made) return tl::unexpected(made.error());
    photographs = std::move(*made);
    previewer.setProjectors(&*photographs);
  }
  if (arguments.orbit > 0)
    return drawSequence(context, arguments, previewer,
                        orbit(view, previewer.cache()->baseHeight(), arguments.orbit), look);
  if (!arguments.flyover.empty()) {
    const auto views = flyover(view, arguments.flyover, arguments.frames);
    if (!views) return tl::unexpected(views.error());
    return drawSequence(context, arguments, previewer, *views, look);
  }

  const auto begin = std::chrono::steady_clock::now();
  const auto frame = previewer.drawSettled(view, look, true);
  if (!frame) return tl::unexpected(frame.error());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  if (auto written = write(arguments.out, frame->picture, true); !written)
    return tl::unexpected(written.error());

  std::size_t hits = 0, steps = 0;
  for (const preview::RayHit& hit : frame->picture.hits) {
    hits += hit.found ? 1 : 0;
    steps += static_cast<std::size_t>(hit.steps);
  }
  const double rays = static_cast<double>(frame->picture.hits.size());
  const preview::RamCache::Counts counts = ram.counts();
  nlohmann::json report{
      {"out", arguments.out},
      {"width", width},
      {"height", height},
      {"from", {geo::degrees(view.position.lat), geo::degrees(view.position.lon), view.position.height_m}},
      {"look", {geo::degrees(view.heading), geo::degrees(view.pitch)}},
      {"seconds", seconds},
      {"tiles", counts.tiles},
      {"photos", frame->projectors},
      {"gpu_mb", static_cast<double>(previewer.textures()->bytes()) * 1e-6},
      {"share_of_map", static_cast<double>(hits) / rays},
      {"steps_per_ray", static_cast<double>(steps) / rays}};
  if (!arguments.at.empty()) {
    const auto at = numbers(arguments.at, "--at", 2);
    if (!at) return tl::unexpected(at.error());
    const int x = static_cast<int>((*at)[0]), y = static_cast<int>((*at)[1]);
    if (x < 0 || y < 0 || x >= width || y >= height)
      return fail(ErrorCode::BadSettings, "--at takes X,Y of a pixel of the picture");
    const preview::RayHit& hit =
        frame->picture.hits[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>(x)];
    if (hit.found) {
      const geo::Geodetic place = previewer.placeOf(hit);
      report["at"] = {{"lat", geo::degrees(place.lat)},
                      {"lon", geo::degrees(place.lon)},
                      {"height_m", place.height_m},
                      {"distance_m", hit.t}};
    } else {
      report["at"] = nullptr;
    }
  }
  if (context.json) {
    fmt::print("{}\n", report.dump());
    return kOk;
  }
  fmt::print(
      "{}: {}x{}, from {:.7f},{:.7f},{:.1f} looking {:.1f},{:.1f}; {} tiles, {:.1f} cells a ray, {:.2f} s\n",
      arguments.out, width, height, geo::degrees(view.position.lat), geo::degrees(view.position.lon),
      view.position.height_m, geo::degrees(view.heading), geo::degrees(view.pitch), counts.tiles,
      static_cast<double>(steps) / rays, seconds);
  if (report.contains("at")) {
    if (report["at"].is_null()) {
      fmt::print("nothing of the map under pixel {}\n", arguments.at);
    } else {
      fmt::print("pixel {}: {:.7f},{:.7f} at {:.2f} m, {:.2f} m away\n", arguments.at,
                 report["at"]["lat"].get<double>(), report["at"]["lon"].get<double>(),
                 report["at"]["height_m"].get<double>(), report["at"]["distance_m"].get<double>());
    }
  }
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto a = std::make_shared<Arguments>();
  command.add_option("MAP", a->map, "the map's .overfly file; it may be in use")->required();
  command
      .add_option("-o,--out", a->out,
                  "the picture, .png or .jpg; several are numbered, or one after the other in a .mjpeg")
      ->required();
  command.add_option(
      "--from", a->from,
      "where to look from: LAT,LON,HEIGHT in degrees and metres of the map's datum (default: all of "
      "the map, from the south)");
  command.add_option("--look", a->look,
                     "HEADING,PITCH in degrees; pitch -90 looks straight down (default: 0,-40)");
  command.add_option("--fov", a->fov, "field of view across the picture, degrees")
      ->check(CLI::Range(1.0, 150.0))
      ->capture_default_str();
  command.add_option("--size", a->size, "WIDTHxHEIGHT in pixels")->capture_default_str();
  command.add_option("--surface", a->surface, "how heights are joined")
      ->check(CLI::IsMember({"blocks", "linear", "bicubic"}))
      ->capture_default_str();
  command.add_option("--filter", a->filter, "how colours are sampled")
      ->check(CLI::IsMember({"nearest", "bilinear", "trilinear", "anisotropic"}))
      ->capture_default_str();
  command.add_option("--anisotropy", a->anisotropy, "samples along a pixel's footprint, at most")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  command.add_option("--mode", a->mode, "what colours show")
      ->check(CLI::IsMember({"color", "elevation", "quality", "age", "level"}))
      ->capture_default_str();
  command.add_option("--no-data", a->no_data, "holes are passed, or hit a hatched patch")
      ->check(CLI::IsMember({"hole", "patch"}))
      ->capture_default_str();
  command.add_option("--relief", a->relief, "shading by slope, from 0 to 1")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command.add_flag("--shadows", a->shadows, "cast shadows");
  command
      .add_option(
          "--photos", a->photos,
          "colour steep sides from this many of the map's photographs, the nearest of those taken at most 45 "
          "degrees from the view's direction; a flight that looks straight down has none for a flat view")
      ->check(CLI::Range(0, preview::ProjectorTextures::kMost))
      ->capture_default_str();
  command.add_option("--sun", a->sun, "where the light comes from: HEADING,HEIGHT in degrees")
      ->capture_default_str();
  command.add_flag("--finest", a->finest, "the finest level everywhere, however far away (slow)");
  command.add_option("--at", a->at, "X,Y: also print the place under this pixel");
  auto* circle = command.add_option("--orbit", a->orbit, "this many pictures around the point looked at")
                     ->check(CLI::Range(2, 10000));
  command
      .add_option("--flyover", a->flyover,
                  "pictures along the view points of this file: LAT,LON,HEIGHT,HEADING,PITCH, one a line")
      ->excludes(circle);
  command.add_option("--frames", a->frames, "pictures of --flyover")
      ->check(CLI::Range(2, 100000))
      ->capture_default_str();
  command.add_option("--memory", a->memory_mb, "MB for tiles, in RAM and on the GPU each")
      ->check(CLI::Range(16, 65536))
      ->capture_default_str();
  context.onRun(command, [a, &context] { return draw(context, *a); });
}

const Registered kRegistered{"preview", "draws a perspective view of a map", build};

}  // namespace
}  // namespace overfly::cli
