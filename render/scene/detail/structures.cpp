#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "render/scene/detail/settlement.h"
#include "render/scene/random.h"

namespace overfly::scene {

void buildBuildings(Site& site) {
  std::uint32_t number = 0;
  for (const BuildingDescription& b : site.scene.buildings) {
    const Eigen::Rotation2Dd rotation(b.turn);
    for (int k = 0; k < b.repeat[2]; ++k) {
      for (int j = 0; j < b.repeat[1]; ++j) {
        for (int i = 0; i < b.repeat[0]; ++i) {
          site.solids.beginObject(
              b.same_tone ? number : number + static_cast<std::uint32_t>(i + 1000 * j + 1000000 * k) * 7);
          const Eigen::Vector2d shift = rotation * Eigen::Vector2d(i * b.step.x(), j * b.step.y());
          const Footprint2 body{b.at + shift, 0.5 * b.size, b.turn};
          if (b.kind == BuildingDescription::Kind::Prism) {
            std::vector<Eigen::Vector2d> polygon;
            double low = 1e9;
            for (const Eigen::Vector2d& p : b.polygon) {
              polygon.emplace_back(p + b.at + shift);
              low = std::min(low, site.terrain.heightAt(polygon.back().x(), polygon.back().y()));
            }
            site.solids.prism(polygon, low - 0.5, low + b.height + k * b.step.z(), b.wall, b.roof);
            for (const Eigen::Vector2d& p : polygon) site.taken.push_back({p, {0.5, 0.5}, 0});
            continue;
          }
          const auto [low, high] = site.groundUnder(body);
          const double foot = k == 0 ? low - 0.5 : high + k * b.step.z();
          const double top = high + k * b.step.z() + b.height;
          if (b.kind == BuildingDescription::Kind::Gable) {
            site.solids.gable(body.centre, b.size, b.turn, foot, top, top + b.ridge, 0.4, b.wall, b.roof);
          } else {
            site.solids.box(body.centre, b.size, b.turn, foot, top, b.wall, b.roof);
          }
          site.taken.push_back(body);
        }
      }
    }
    number += 101;
  }
}

void buildCity(Site& site, const CityDescription& city) {
  const std::uint32_t seed = seedOf(site.scene.seed, "city");
  const Eigen::Vector2d pitch = city.block + Eigen::Vector2d::Constant(city.street);
  const int columns = static_cast<int>((city.extent.x() + city.street) / pitch.x());
  const int rows = static_cast<int>((city.extent.y() + city.street) / pitch.y());
  const Eigen::Vector2d first = -0.5 * Eigen::Vector2d((columns - 1) * pitch.x(), (rows - 1) * pitch.y());
  for (int i = 0; i <= columns; ++i) {
    const double x = first.x() + (i - 0.5) * pitch.x(), y = 0.5 * (rows * pitch.y() + city.street);
    site.cover.paintStreet({{x, -y}, {x, y}}, city.street - 3);
  }
  for (int k = 0; k <= rows; ++k) {
    const double y = first.y() + (k - 0.5) * pitch.y(), x = 0.5 * (columns * pitch.x() + city.street);
    site.cover.paintStreet({{-x, y}, {x, y}}, city.street - 3);
  }
  for (int k = 0; k < rows; ++k) {
    for (int i = 0; i < columns; ++i) {
      const std::uint32_t block = hashOf(seed, static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(k));
      const Eigen::Vector2d centre = first + Eigen::Vector2d(i * pitch.x(), k * pitch.y());
      // Two to four houses side by side along the block, each of its own height, with set-back roofs.
      const int houses = 2 + static_cast<int>(3 * uniform(block, 1));
      const double width = city.block.x() / houses;
      for (int h = 0; h < houses; ++h) {
        const std::uint32_t house = hashOf(block, 10, static_cast<std::uint32_t>(h));
        const Footprint2 body{centre + Eigen::Vector2d((h + 0.5) * width - 0.5 * city.block.x(), 0),
                              0.5 * Eigen::Vector2d(width, city.block.y() - 6 * uniform(house, 1)), 0};
        const auto [low, high] = site.groundUnder(body);
        const double roof =
            high + city.heights.x() + uniform(house, 2) * (city.heights.y() - city.heights.x());
        site.solids.beginObject(house & 0xffffff);
        site.solids.box(body.centre, 2 * body.half, 0, low - 0.5, roof, Material::Plaster,
                        Material::FlatRoof);
        site.taken.push_back(body);
        // What stands on flat roofs: stair heads, machines.
        const int things = 1 + static_cast<int>(4 * uniform(house, 3));
        for (int t = 0; t < things; ++t) {
          const std::uint32_t thing = hashOf(house, 20, static_cast<std::uint32_t>(t));
          const Eigen::Vector2d size(2 + 3 * uniform(thing, 1), 2 + 4 * uniform(thing, 2));
          const Eigen::Vector2d free = (body.half - 0.5 * size - Eigen::Vector2d::Constant(0.8)).cwiseMax(0);
          const Eigen::Vector2d at = body.centre + Eigen::Vector2d((2 * uniform(thing, 3) - 1) * free.x(),
                                                                   (2 * uniform(thing, 4) - 1) * free.y());
          site.solids.beginObject(thing & 0xffffff);
          site.solids.box(at, size, 0, roof, roof + 1 + 2.4 * uniform(thing, 5), Material::Concrete,
                          Material::FlatRoof);
        }
      }
    }
  }
}

void buildCanyon(Site& site, const CanyonDescription& canyon) {
  const std::uint32_t seed = seedOf(site.scene.seed, "canyon");
  const double west = site.terrain.west_south().x(), east = site.terrain.east_north().x();
  const double south = site.terrain.west_south().y(), north = site.terrain.east_north().y();
  const double length = east - west;
  const int steps = std::max(8, static_cast<int>(length / 9));
  for (const double side : {-1.0, 1.0}) {
    std::vector<Eigen::Vector2d> edge;
    for (int i = 0; i <= steps; ++i) {
      const double x = west + length * i / steps;
      const double middle =
          canyon.winding * std::sin(2.0 * std::numbers::pi * 1.15 * (x - west) / length + 0.6);
      const double rough =
          canyon.roughness * (2 * uniform(seed, static_cast<std::uint32_t>(i), side > 0 ? 1 : 2) - 1);
      edge.emplace_back(x, middle + side * (0.5 * canyon.width + rough));
    }
    // The plateau in terraces of up to 6 m, each one prism from the edge to the scene's border.
    constexpr int kTerrace = 8;  // steps of the edge
    for (int first = 0; first < steps; first += kTerrace) {
      const int last = std::min(first + kTerrace, steps);
      const double border = side > 0 ? north : south;
      std::vector<Eigen::Vector2d> terrace(edge.begin() + first, edge.begin() + last + 1);
      terrace.emplace_back(terrace.back().x(), border);
      terrace.emplace_back(terrace.front().x(), border);
      if (side < 0) std::reverse(terrace.begin(), terrace.end());
      const double above = 6 * uniform(seed, static_cast<std::uint32_t>(first), side > 0 ? 3 : 4);
      double ground = 0;
      for (const Eigen::Vector2d& p : terrace) ground = std::min(ground, site.terrain.heightAt(p.x(), p.y()));
      site.solids.beginObject(static_cast<std::uint32_t>(first) * 2 + (side > 0 ? 1u : 0u));
      site.solids.prism(terrace, ground - 8, canyon.depth + above, Material::Rock, Material::Plateau);
    }
  }
}

}  // namespace overfly::scene
