#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "capture/camera_model.h"
#include "capture/geo/geodetic.h"
#include "config/error.h"
#include "render/scene/effect_settings.h"

namespace overfly::scene {

// A scene as its TOML file says it. Plain values; positions are (east, north) in metres in the East-North-Up
// frame of `place`, heights are metres above that frame's horizontal plane unless a comment says otherwise.
// docs: every field is the TOML key of the same name in the section that the struct names.

// [terrain]
struct TerrainDescription {
  enum class Kind { Flat, Ramp, Fractal, Map };
  Kind kind = Kind::Flat;
  Eigen::Vector2d extent{300, 300};  // size of the ground around the origin, metres east, north
  double spacing = 1;                // side of the ground's triangles, metres
  Eigen::Vector2d slope{0, 0};       // Ramp, Fractal: rise per metre towards east, north
  double relief = 0;                 // Fractal: greatest deviation from the ramp, metres
  double feature = 80;               // Fractal: size of the largest forms, metres
  std::filesystem::path map;         // Map: a one-band GeoTIFF or PNG, stretched over `extent`, north up
  double map_scale = 1;              // Map: metres per unit of the file
  double map_offset = 0;             // Map: metres added
};

// What covers the ground; the numbers are those of shaders/material.glsl.
enum class Base : std::uint8_t { Lawn, Meadow, Soil, Crop, ForestFloor, Gravel, Sand, Water, Yard, Corn };

// [[area]]: a polygon of one base; later areas lie over earlier ones.
struct AreaDescription {
  Base base = Base::Meadow;
  std::vector<Eigen::Vector2d> polygon;
};

// [[street]]
struct StreetDescription {
  std::vector<Eigen::Vector2d> points;
  double width = 6;             // carriageway, metres
  bool houses = false;          // plots with houses on both sides, see [settlement]
  double plot = 18;             // width of a plot along the street, metres
  int parked_cars_percent = 0;  // of the kerb places
};

// [settlement]: what a plot beside a street with houses = true gets.
struct SettlementDescription {
  double setback = 6;  // house front to street edge, metres
  double depth = 34;   // of a plot, metres
  Eigen::Vector2d storeys{1, 2};
  double hedges = 0.6;  // share of plots
  double sheds = 0.5;
};

enum class Material : std::uint8_t {
  Concrete,
  ClayTiles,
  Slate,
  FlatRoof,
  Plaster,
  Container,
  Rock,
  Hedge,
  Car,
  Timber,
  Plateau
};

// [[building]]: a box, a gabled house or a prism over a polygon, with `repeat` copies `step` apart.
struct BuildingDescription {
  enum class Kind { Box, Gable, Prism };
  Kind kind = Kind::Box;
  Eigen::Vector2d at{0, 0};              // centre of the footprint; for a prism an offset of the polygon
  Eigen::Vector2d size{10, 8};           // along the ridge, across it, metres
  double turn = 0;                       // of the size's first axis from east, counter-clockwise, radians
  double height = 6;                     // of the eaves or the flat top above the ground there, metres
  double ridge = 3;                      // Gable: of the ridge above the eaves, metres
  std::vector<Eigen::Vector2d> polygon;  // Prism: counter-clockwise
  Material wall = Material::Plaster;
  Material roof = Material::ClayTiles;
  std::array<int, 3> repeat{1, 1, 1};  // copies east', north' (turned with the building) and up
  Eigen::Vector3d step{0, 0, 0};       // metres between copies
  bool same_tone = false;              // every copy alike: repetition on purpose
};

// [city]: blocks of boxes on a street grid.
struct CityDescription {
  Eigen::Vector2d extent{200, 200};
  Eigen::Vector2d block{48, 40};    // metres between street edges
  double street = 9;                // metres
  Eigen::Vector2d heights{20, 60};  // metres
};

// [canyon]: a plateau cut by a winding canyon with vertical walls, along the east axis; floor at the terrain.
struct CanyonDescription {
  double depth = 150;    // metres
  double width = 90;     // between the walls, metres
  double winding = 40;   // amplitude of the centre line, metres
  double roughness = 6;  // of the walls' outline, metres
};

// [[vegetation]]: plants on a polygon (empty: everywhere) or a base, after render/amplify.
struct VegetationDescription {
  enum class Species { Broadleaf = 1, Conifer = 2, Shrub = 3 };
  Species species = Species::Broadleaf;
  double per_hectare = 100;  // plants that the ground's class would carry
  std::vector<Eigen::Vector2d> polygon;
  std::optional<Base> on;         // only where the ground has this base
  Eigen::Vector2d height{6, 12};  // metres, least and greatest
};

// [sun]
struct SunDescription {
  double azimuth = 2.6;    // towards the sun, from north over east, radians
  double elevation = 0.9;  // above the horizon, radians
};

// [path]
struct PathDescription {
  enum class Kind { LawnMower, Orbit, WayPoints };
  Kind kind = Kind::LawnMower;
  double height = 50;  // of the camera above the origin's plane, metres
  double speed = 5;    // metres per second
  int frames = 60;
  double interval_s = 0;         // between frames; 0: LawnMower from the overlaps, else 1
  double forward_overlap = 0.8;  // LawnMower: shares of the footprint at `ground`
  double side_overlap = 0.7;
  double ground = 0;  // height that overlaps and the GSD are meant at, metres
  int lines = 4;
  double heading = 0;  // LawnMower: of the first line, from north over east, radians
  Eigen::Vector2d centre{0, 0};
  double radius = 50;                   // Orbit
  double pitch = -1.5707963267948966;   // of the camera: -pi/2 looks straight down, radians
  std::vector<Eigen::Vector3d> points;  // WayPoints: east, north, height
  double drift = 0;                     // wind: smooth deviation from the path, metres
  double sway = 0;                      // wind: smooth deviation from level flight, radians
};

struct SceneDescription {
  std::string name;
  std::string why;  // one paragraph: what the scene is for and why its effects
  std::uint32_t seed = 1;
  geo::Geodetic place;  // origin of the scene's ENU frame, on the ground, ellipsoidal height
  TerrainDescription terrain;
  Base base = Base::Lawn;
  std::vector<AreaDescription> areas;
  std::vector<StreetDescription> streets;
  double pavement = 1.5;      // beside streets, metres
  bool street_lines = false;  // painted edge lines
  SettlementDescription settlement;
  std::vector<BuildingDescription> buildings;
  std::optional<CityDescription> city;
  std::optional<CanyonDescription> canyon;
  std::vector<VegetationDescription> vegetation;
  SunDescription sun;
  capture::CameraModel camera;  // the ideal lens; distortion is an effect
  PathDescription path;
  std::vector<EffectSettings> effects;  // in the file's order; only those that it names
};

// Reads and checks a scene. Unavailable: the file is not there; BadSettings: one sentence with file, line and
// key. A name without '/' and ".toml" is looked for in OVERFLY_SCENES and in the installed and source scenes'
// folders.
[[nodiscard]] Result<SceneDescription> loadScene(const std::filesystem::path& file_or_name);
[[nodiscard]] Result<SceneDescription> parseScene(const std::string& toml, const std::string& file_name);

}  // namespace overfly::scene
