#pragma once
#include <memory>
#include <string>
#include <vector>

#include "config/error.h"

namespace overfly::geo {

// Height of a geoid above the WGS84 ellipsoid, from a grid in PROJ's .gtx format. Value type (copies share
// the grid); reentrant.
//
//   ellipsoidal height = geoid height (above mean sea level) + undulation
//
// Interpolation is bilinear between the grid's points, which is what PROJ does: a map that is exported with
// a geoid height reference comes back to our own ellipsoidal heights in every program that uses PROJ. The
// bilinear surface of the 15' EGM96 grid is within 1.2 m of the full model, rms 4 cm (GeographicLib's Geoid
// documentation).
class Geoid {
 public:
  static constexpr const char* kDefaultGrid = "/usr/share/proj/egm96_15.gtx";

  // Unavailable when the file is absent (the message names the Debian package), Corrupt when it is no .gtx
  // grid or does not cover what its header says.
  [[nodiscard]] static Result<Geoid> load(const std::string& path = kDefaultGrid);

  // Metres; NaN outside the grid or where it has no data. Latitude and longitude in radians; the longitude
  // may be any turn of the globe.
  [[nodiscard]] double undulation(double lat, double lon) const;

  [[nodiscard]] double ellipsoidalFromGeoid(double lat, double lon, double height_m) const {
    return height_m + undulation(lat, lon);
  }
  [[nodiscard]] double geoidFromEllipsoidal(double lat, double lon, double height_m) const {
    return height_m - undulation(lat, lon);
  }

  // File name without folder and ending, "egm96_15": the datum's name in maps and exports.
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  Geoid() = default;
  [[nodiscard]] double at(int row, int column) const;

  std::string name_;
  double south_deg_ = 0, west_deg_ = 0, step_lat_deg_ = 0, step_lon_deg_ = 0;
  int rows_ = 0, columns_ = 0;
  bool around_ = false;                             // the columns close the circle
  std::shared_ptr<const std::vector<float>> grid_;  // row 0 south
};

}  // namespace overfly::geo
