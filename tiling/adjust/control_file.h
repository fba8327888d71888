#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "capture/geo/geodetic.h"
#include "config/error.h"

namespace overfly::tiling::adjust {

// One ground control or check point with the pictures that show it.
struct ControlEntry {
  std::string name;
  geo::Geodetic place;  // height in the flight's own datum, as the file says it
  Eigen::Vector3d sigma_m = Eigen::Vector3d::Constant(0.03);  // east, north, up
  bool check = false;                                         // compared, not used
  struct Mark {
    std::string image;      // file name without folder
    Eigen::Vector2d pixel;  // first pixel's centre at (0.5, 0.5)
  };
  std::vector<Mark> marks;
};

// Reads ground control from either of:
//  - OpenDroneMap's gcp_list.txt: first line "EPSG:4326", "EPSG:326zz"/"EPSG:327zz", "WGS84 UTM 16N" or a
//    +proj=longlat / +proj=utm string; then lines "x y z pixel_x pixel_y image [name]";
//  - CSV with a header naming at least name,lat,lon,height,image,px,py (degrees, metres, pixels) and, if
//    wanted, sigma (metres, horizontal), sigma_up, check (1: compare only).
// Lines of one point are brought together by name (gcp_list.txt without names: by equal coordinates).
// NotFound, BadInput with the line's number, Unsupported for another projection.
[[nodiscard]] Result<std::vector<ControlEntry>> readControlFile(const std::filesystem::path& file);

}  // namespace overfly::tiling::adjust
