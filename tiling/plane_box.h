#pragma once

namespace overfly::tiling {

// An axis-aligned box in the lattice's plane coordinates (units of whole cells at zoom 0; px east, py south).
struct PlaneBox {
  double west = 0, north = 0, east = 0, south = 0;
  [[nodiscard]] bool intersects(const PlaneBox& other) const {
    return west < other.east && other.west < east && north < other.south && other.north < south;
  }
  friend bool operator==(const PlaneBox&, const PlaneBox&) = default;
};

}  // namespace overfly::tiling
