#include "capture/geo/vertical_datum.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "capture/geo/geodetic.h"

namespace overfly::geo {
namespace {

// Expected values: gdaltransform (PROJ 9.1) from EPSG:4326+5773 to EPSG:4979, on the same grid (bilinear
// too).
TEST(Geoid, AgreesWithProj) {
  const auto geoid = Geoid::load();
  ASSERT_TRUE(geoid.has_value()) << geoid.error().message;
  EXPECT_EQ(geoid->name(), "egm96_15");
  struct Case {
    double lat_deg, lon_deg, undulation_m;
  };
  for (const Case& c : {Case{48.4, 9.99, 47.3119435730}, Case{-33.86, 151.21, 22.4554317902},
                        Case{4.62, 78.93, -106.9403605713}, Case{-12.345, 179.99, 42.3219832062},
                        Case{0.1, -179.95, 20.9634201813}, Case{82.5, -61.7, 19.2831096649}}) {
    EXPECT_NEAR(geoid->undulation(radians(c.lat_deg), radians(c.lon_deg)), c.undulation_m, 1e-3)
        << c.lat_deg << ", " << c.lon_deg;
    EXPECT_NEAR(geoid->undulation(radians(c.lat_deg), radians(c.lon_deg + 360)), c.undulation_m, 1e-3);
  }
}

TEST(Geoid, ContinuousAcrossTheAntimeridianAndAtThePoles) {
  const auto geoid = Geoid::load();
  ASSERT_TRUE(geoid.has_value()) << geoid.error().message;
  for (double lat : {-89.9, -33.3, 0.1, 71.0}) {
    EXPECT_NEAR(geoid->undulation(radians(lat), radians(179.9999999)),
                geoid->undulation(radians(lat), radians(-179.9999999)), 1e-5);
    EXPECT_FALSE(std::isnan(geoid->undulation(radians(lat), radians(179.9))));
  }
  EXPECT_NEAR(geoid->undulation(radians(90), 0), geoid->undulation(radians(90), 2), 1e-6);
  EXPECT_FALSE(std::isnan(geoid->undulation(radians(-90), 1)));
}

TEST(Geoid, HeightsRoundTrip) {
  const auto geoid = Geoid::load();
  ASSERT_TRUE(geoid.has_value()) << geoid.error().message;
  const double lat = radians(48.4), lon = radians(9.99), msl = 512.25;
  const double ellipsoidal = geoid->ellipsoidalFromGeoid(lat, lon, msl);
  EXPECT_GT(ellipsoidal, msl + 40);
  EXPECT_NEAR(geoid->geoidFromEllipsoidal(lat, lon, ellipsoidal), msl, 1e-12);
}

TEST(Geoid, AbsentGridNamesThePackageAndDamagedOnesAreRefused) {
  const auto absent = Geoid::load("/nonexistent/egm96_15.gtx");
  ASSERT_FALSE(absent.has_value());
  EXPECT_EQ(absent.error().code, ErrorCode::Unavailable);
  EXPECT_NE(absent.error().message.find("proj-data"), std::string::npos);

  const auto folder = std::filesystem::temp_directory_path() / "overfly_geoid_test";
  std::filesystem::create_directories(folder);
  std::ifstream whole(Geoid::kDefaultGrid, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(whole)), {});
  const auto refused = [&](const std::string& name, const std::string& content) {
    const auto path = folder / name;
    std::ofstream(path, std::ios::binary) << content;
    const auto geoid = Geoid::load(path.string());
    ASSERT_FALSE(geoid.has_value()) << name;
    EXPECT_EQ(geoid.error().code, ErrorCode::Corrupt) << name;
  };
  refused("empty.gtx", "");
  refused("cut.gtx", bytes.substr(0, bytes.size() / 2));
  refused("longer.gtx", bytes + "x");
  refused("text.gtx", std::string(2000, 'a'));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace overfly::geo
