#include "render/scene/description.h"

#include <fmt/format.h>

#include <cstdlib>
#include <fstream>
#include <numbers>
#include <sstream>

#include "render/scene/detail/toml_section.h"
#include "render/scene/random.h"

namespace overfly::scene {
namespace {

const std::vector<std::pair<std::string_view, Base>> kBases = {
    {"lawn", Base::Lawn},          {"meadow", Base::Meadow}, {"soil", Base::Soil}, {"crop", Base::Crop},
    {"forest", Base::ForestFloor}, {"gravel", Base::Gravel}, {"sand", Base::Sand}, {"water", Base::Water},
    {"yard", Base::Yard},          {"corn", Base::Corn}};

const std::vector<std::pair<std::string_view, Material>> kMaterials = {
    {"concrete", Material::Concrete}, {"clay_tiles", Material::ClayTiles},
    {"slate", Material::Slate},       {"flat_roof", Material::FlatRoof},
    {"plaster", Material::Plaster},   {"container", Material::Container},
    {"rock", Material::Rock},         {"hedge", Material::Hedge},
    {"car", Material::Car},           {"timber", Material::Timber},
    {"plateau", Material::Plateau}};

constexpr double kFar = 20000;  // metres: no scene is larger, so that float32 keeps 2 mm everywhere

void readTerrain(TomlSection section, TerrainDescription& terrain) {
  using Kind = TerrainDescription::Kind;
  terrain.kind = section.choice(
      "kind", terrain.kind,
      {{"flat", Kind::Flat}, {"ramp", Kind::Ramp}, {"fractal", Kind::Fractal}, {"map", Kind::Map}});
  terrain.extent = section.pair("extent", terrain.extent);
  terrain.spacing = section.number("spacing", terrain.spacing, 0.05, 100);
  terrain.slope = section.pair("slope", terrain.slope);
  terrain.relief = section.number("relief", terrain.relief, 0, 5000);
  terrain.feature = section.number("feature", terrain.feature, 1, kFar);
  terrain.map = section.text("map", "");
  terrain.map_scale = section.number("map_scale", terrain.map_scale, -1e6, 1e6);
  terrain.map_offset = section.number("map_offset", terrain.map_offset, -1e5, 1e5);
  if (terrain.kind == Kind::Map && terrain.map.empty()) section.problem("map", "must name a file");
  if (!(terrain.extent.minCoeff() > 0 && terrain.extent.maxCoeff() <= kFar)) {
    section.problem("extent", "must be two lengths between 0 and 20000 m");
  } else if (terrain.extent.x() / terrain.spacing * terrain.extent.y() / terrain.spacing > 4e6) {
    section.problem("spacing", "makes more than 4 million cells; raise it");
  }
  section.finish();
}

BuildingDescription readBuilding(TomlSection& section) {
  using Kind = BuildingDescription::Kind;
  BuildingDescription b;
  b.kind =
      section.choice("kind", b.kind, {{"box", Kind::Box}, {"gable", Kind::Gable}, {"prism", Kind::Prism}});
  b.at = section.pair("at", b.at);
  b.size = section.pair("size", b.size);
  b.turn = section.angle("turn_deg", b.turn, -360, 360);
  b.height = section.number("height", b.height, 0.01, 2000);
  b.ridge = section.number("ridge", b.ridge, 0, 200);
  b.polygon = section.polygon("polygon");
  b.wall = section.choice("wall", b.wall, kMaterials);
  b.roof = section.choice("roof", b.kind == Kind::Gable ? b.roof : Material::FlatRoof, kMaterials);
  const std::vector<double> repeat = section.numbers("repeat", {1, 1, 1}, 3);
  const std::vector<double> step = section.numbers("step", {0, 0, 0}, 3);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(repeat[i] >= 1 && repeat[i] <= 1000))
      section.problem("repeat", "must be three counts of 1 to 1000");
    b.repeat[i] = static_cast<int>(repeat[i]);
    b.step[static_cast<Eigen::Index>(i)] = step[i];
  }
  b.same_tone = section.flag("same_tone", b.same_tone);
  if (b.kind == Kind::Prism && b.polygon.size() < 3) section.problem("polygon", "must be given for a prism");
  if (!(b.size.minCoeff() > 0)) section.problem("size", "must be two positive lengths");
  section.finish();
  return b;
}

void readPath(TomlSection section, PathDescription& path) {
  using Kind = PathDescription::Kind;
  path.kind = section.choice(
      "kind", path.kind,
      {{"lawnmower", Kind::LawnMower}, {"orbit", Kind::Orbit}, {"waypoints", Kind::WayPoints}});
  path.height = section.number("height", path.height, 0.5, 10000);
  path.speed = section.number("speed", path.speed, 0.01, 100);
  path.frames = section.integer("frames", path.frames, 1, 100000);
  path.interval_s = section.number("interval_s", path.interval_s, 0, 3600);
  path.forward_overlap = section.number("forward_overlap", path.forward_overlap, 0, 0.99);
  path.side_overlap = section.number("side_overlap", path.side_overlap, 0, 0.99);
  path.ground = section.number("ground", path.ground, -5000, 9000);
  path.lines = section.integer("lines", path.lines, 1, 1000);
  path.heading = section.angle("heading_deg", path.heading, -360, 360);
  path.centre = section.pair("centre", path.centre);
  path.radius = section.number("radius", path.radius, 0.5, 10000);
  path.pitch = section.angle("pitch_deg", path.pitch, -90, 30);
  for (const Eigen::VectorXd& point : section.points("points", 3)) path.points.emplace_back(point);
  path.drift = section.number("drift", path.drift, 0, 100);
  path.sway = section.angle("sway_deg", path.sway, 0, 45);
  if (path.kind == Kind::WayPoints && path.points.size() < 2) {
    section.problem("points", "must have at least two way-points");
  }
  if (path.height <= path.ground) section.problem("height", "must lie above path.ground");
  if (path.lines > path.frames) section.problem("lines", "must not be more than the frames");
  section.finish();
}

void readCamera(TomlSection section, capture::CameraModel& camera) {
  camera.width = section.integer("width", 1600, 16, 16384);
  camera.height = section.integer("height", 1200, 16, 16384);
  camera.fx = section.number("fx", 0.75 * camera.width, 1, 1e6);
  camera.fy = section.number("fy", camera.fx, 1, 1e6);
  camera.cx = section.number("cx", 0.5 * camera.width, 0, 16384);
  camera.cy = section.number("cy", 0.5 * camera.height, 0, 16384);
  section.finish();
}

void readEffects(TomlSection& root, SceneDescription& scene) {
  TomlSection parameters = root.section("effect");
  for (const std::string& name : root.texts("effects")) {
    const std::optional<Effect> effect = effectNamed(name);
    if (!effect) {
      std::string known;
      for (const EffectInfo& info : allEffects())
        known += (known.empty() ? "" : ", ") + std::string(info.name);
      root.problem("effects", "names \"" + name + "\"; known are " + known);
      continue;
    }
    if (findEffect(scene.effects, *effect)) {
      root.problem("effects", "names \"" + name + "\" twice");
      continue;
    }
    EffectSettings settings = defaultSettings(*effect, scene.seed);
    TomlSection own = parameters.section(name);
    for (const EffectParameter& parameter : infoOf(*effect).parameters) {
      double& value = settings.values.find(parameter.key)->second;
      value = own.number(parameter.key, value, parameter.least, parameter.most);
    }
    own.finish();
    scene.effects.push_back(std::move(settings));
  }
  // A section for an effect that the list does not name is most likely a slip: finish() says so.
  parameters.finish();
}

void readSurroundings(TomlSection& root, SceneDescription& scene) {
  readTerrain(root.section("terrain"), scene.terrain);
  for (TomlSection& section : root.list("area")) {
    AreaDescription area;
    area.base = section.choice("base", area.base, kBases);
    area.polygon = section.polygon("polygon");
    if (area.polygon.empty()) section.problem("polygon", "must be given");
    section.finish();
    scene.areas.push_back(std::move(area));
  }
  for (TomlSection& section : root.list("street")) {
    StreetDescription street;
    for (const Eigen::VectorXd& point : section.points("points", 2)) street.points.emplace_back(point);
    if (street.points.size() < 2) section.problem("points", "must have at least two points");
    street.width = section.number("width", street.width, 0.5, 100);
    street.houses = section.flag("houses", street.houses);
    street.plot = section.number("plot", street.plot, 6, 500);
    street.parked_cars_percent = section.integer("parked_cars_percent", 0, 0, 100);
    section.finish();
    scene.streets.push_back(std::move(street));
  }
  TomlSection settlement = root.section("settlement");
  scene.settlement.setback = settlement.number("setback", scene.settlement.setback, 0, 100);
  scene.settlement.depth = settlement.number("depth", scene.settlement.depth, 5, 500);
  scene.settlement.storeys = settlement.pair("storeys", scene.settlement.storeys);
  scene.settlement.hedges = settlement.number("hedges", scene.settlement.hedges, 0, 1);
  scene.settlement.sheds = settlement.number("sheds", scene.settlement.sheds, 0, 1);
  settlement.finish();
  for (TomlSection& section : root.list("building")) scene.buildings.push_back(readBuilding(section));
}

void readGenerators(TomlSection& root, SceneDescription& scene) {
  if (TomlSection section = root.section("city"); section.present()) {
    CityDescription& city = scene.city.emplace();
    city.extent = section.pair("extent", city.extent);
    city.block = section.pair("block", city.block);
    city.street = section.number("street", city.street, 1, 200);
    city.heights = section.pair("heights", city.heights);
    if (!(city.block.minCoeff() >= 5)) section.problem("block", "must be at least 5 m by 5 m");
    section.finish();
  }
  if (TomlSection section = root.section("canyon"); section.present()) {
    CanyonDescription& canyon = scene.canyon.emplace();
    canyon.depth = section.number("depth", canyon.depth, 1, 3000);
    canyon.width = section.number("width", canyon.width, 1, 3000);
    canyon.winding = section.number("winding", canyon.winding, 0, 3000);
    canyon.roughness = section.number("roughness", canyon.roughness, 0, 300);
    section.finish();
  }
  using Species = VegetationDescription::Species;
  for (TomlSection& section : root.list("vegetation")) {
    VegetationDescription plants;
    plants.species = section.choice(
        "species", plants.species,
        {{"broadleaf", Species::Broadleaf}, {"conifer", Species::Conifer}, {"shrub", Species::Shrub}});
    plants.per_hectare = section.number("per_hectare", plants.per_hectare, 0, 20000);
    plants.polygon = section.polygon("polygon");
    if (section.has("on")) plants.on = section.choice("on", Base::Meadow, kBases);
    plants.height = section.pair("height", plants.height);
    if (!(plants.height.x() > 0 && plants.height.y() >= plants.height.x())) {
      section.problem("height", "must be two heights, the smaller first");
    }
    section.finish();
    scene.vegetation.push_back(std::move(plants));
  }
}

}  // namespace

Result<SceneDescription> parseScene(const std::string& text, const std::string& file_name) {
  toml::table table;
  try {
    table = toml::parse(text, file_name);
  } catch (const toml::parse_error& error) {
    return fail(ErrorCode::BadSettings, fmt::format("{}:{}: {}", file_name, error.source().begin.line,
                                                    std::string(error.description())));
  }
  TomlProblems problems(file_name);
  TomlSection root(problems, &table, "");
  SceneDescription scene;
  scene.name = root.text("name", std::filesystem::path(file_name).stem().string());
  scene.why = root.text("why", "");
  scene.seed = static_cast<std::uint32_t>(root.integer("seed", 1, 0, 2147483647));
  TomlSection place = root.section("place");
  scene.place = {place.angle("lat_deg", 0, -89.9, 89.9), place.angle("lon_deg", 0, -180, 180),
                 place.number("height_m", 0, -500, 9000)};
  place.finish();
  scene.base = root.choice("base", scene.base, kBases);
  scene.pavement = root.number("pavement", scene.pavement, 0, 3.5);
  scene.street_lines = root.flag("street_lines", scene.street_lines);
  readSurroundings(root, scene);
  readGenerators(root, scene);
  TomlSection sun = root.section("sun");
  scene.sun.azimuth = sun.angle("azimuth_deg", scene.sun.azimuth, -360, 360);
  scene.sun.elevation = sun.angle("elevation_deg", scene.sun.elevation, 5, 90);
  sun.finish();
  readCamera(root.section("camera"), scene.camera);
  readPath(root.section("path"), scene.path);
  readEffects(root, scene);
  root.finish();
  if (problems.first()) return tl::unexpected<Error>(*problems.first());
  return scene;
}

Result<SceneDescription> loadScene(const std::filesystem::path& file_or_name) {
  std::filesystem::path file = file_or_name;
  const bool is_name = !file.has_parent_path() && file.extension() != ".toml";
  if (is_name) {
    std::vector<std::filesystem::path> folders;
    if (const char* own = std::getenv("OVERFLY_SCENES")) folders.emplace_back(own);
    folders.emplace_back("/usr/share/overfly/scenes");
    folders.emplace_back(OVERFLY_SOURCE_SCENES);
    for (const std::filesystem::path& folder : folders) {
      const std::filesystem::path candidate = folder / (file_or_name.string() + ".toml");
      std::error_code ignored;
      if (std::filesystem::exists(candidate, ignored)) {
        file = candidate;
        break;
      }
    }
  }
  std::ifstream stream(file);
  if (!stream) {
    return fail(ErrorCode::Unavailable,
                is_name
                    ? fmt::format("there is no scene \"{}\"; give the path of a scene file", file.string())
                    : fmt::format("{}: cannot be read", file.string()));
  }
  std::ostringstream text;
  text << stream.rdbuf();
  Result<SceneDescription> scene = parseScene(text.str(), file.string());
  if (scene && !scene->terrain.map.empty() && scene->terrain.map.is_relative()) {
    scene->terrain.map = file.parent_path() / scene->terrain.map;
  }
  return scene;
}

}  // namespace overfly::scene
