// Drone JPEGs, made here with the tags that drones write, through the importer.
#include <gtest/gtest.h>

#include <cmath>
#include <exiv2/exiv2.hpp>
#include <fstream>
#include <map>
#include <numbers>

#include "capture/geo/footprint.h"
#include "capture/import/device_pose.h"
#include "capture/import/import_flight.h"
#include "tests/integration/flight/made_frames.h"

namespace overfly::capture {
namespace {

using testing_data::TemporaryFolder;
using Texts = std::map<std::string, std::string>;

void writeJpeg(const std::filesystem::path& file, const Texts& exif, const Texts& dji,
               const Texts& pix4d = {}) {
  const auto bytes = testing_data::madeFrame(1, PixelFormat::Jpeg, 80, 60).image.bytes;
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const auto image = Exiv2::ImageFactory::open(file.string());
  image->readMetadata();
  for (const auto& [key, value] : exif) image->exifData()[key] = value;
  // As drones write it: a packet of attributes whose name spaces no reader was told of before.
  std::string packet =
      "<?xpacket begin='\xef\xbb\xbf' id='W5M0MpCehiHzreSzNTczkc9d'?><x:xmpmeta "
      "xmlns:x='adobe:ns:meta/'><rdf:RDF "
      "xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'><rdf:Description rdf:about='' "
      "xmlns:drone-dji='http://www.dji.com/drone-dji/1.0/' xmlns:Camera='http://pix4d.com/camera/1.0/'";
  for (const auto& [key, value] : dji) packet += " drone-dji:" + key + "='" + value + "'";
  for (const auto& [key, value] : pix4d) packet += " Camera:" + key + "='" + value + "'";
  packet += "/></rdf:RDF></x:xmpmeta><?xpacket end='w'?>";
  if (!dji.empty() || !pix4d.empty()) {
    image->setXmpPacket(packet);
    image->writeXmpFromPacket(true);
  }
  image->writeMetadata();
}

Texts place(const std::string& time) {
  return {{"Exif.Image.Make", "DJI"},
          {"Exif.Image.Model", "FC300S"},
          {"Exif.Photo.DateTimeOriginal", time},
          {"Exif.Photo.FocalLengthIn35mmFilm", "20"},
          {"Exif.Photo.ExposureTime", "1/500"},
          {"Exif.GPSInfo.GPSLatitude", "46/1 50/1 333834/10000"},
          {"Exif.GPSInfo.GPSLatitudeRef", "N"},
          {"Exif.GPSInfo.GPSLongitude", "91/1 59/1 404156/10000"},
          {"Exif.GPSInfo.GPSLongitudeRef", "W"},
          {"Exif.GPSInfo.GPSAltitude", "198309/1000"},
          {"Exif.GPSInfo.GPSAltitudeRef", "0"}};
}

Texts gimbal(const std::string& yaw, const std::string& pitch = "-90.00") {
  return {{"AbsoluteAltitude", "+198.31"}, {"RelativeAltitude", "+39.80"}, {"GimbalYawDegree", yaw},
          {"GimbalPitchDegree", pitch},    {"GimbalRollDegree", "+0.00"},  {"FlightYawDegree", "+46.00"},
          {"FlightPitchDegree", "+1.80"},  {"FlightRollDegree", "+3.00"}};
}

TEST(DroneJpegs, PlaceTimeAttitudeAndFocalLengthAreRead) {
  const TemporaryFolder folder;
  writeJpeg(folder / "DJI_0001.JPG", place("2016:06:23 16:31:59"), gimbal("+45.00"));
  writeJpeg(folder / "DJI_0002.JPG", place("2016:06:23 16:32:06"), gimbal("-135.00"));
  const auto flight = importFlight(folder.path());
  ASSERT_TRUE(flight) << flight.error().message;
  ASSERT_EQ(flight->size(), 2u);
  const auto frame = flight->load(0);
  ASSERT_TRUE(frame) << frame.error().message;
  EXPECT_EQ((*frame)->camera_id, "DJI FC300S");
  EXPECT_EQ((*frame)->exposure_ns, 2'000'000);
  EXPECT_NEAR((*frame)->camera.fx, 20 * 100 / std::hypot(36, 24), 1e-9);  // 80x60 px: the diagonal is 100 px
  EXPECT_DOUBLE_EQ((*frame)->camera.cx, 40);
  EXPECT_EQ(flight->at(1).frame.time_ns - flight->at(0).frame.time_ns, 7'000'000'000);
  ASSERT_TRUE((*frame)->pose);
  const geo::Geodetic at = geo::geodeticFromEcef((*frame)->pose->position_in_ecef);
  EXPECT_NEAR(geo::degrees(at.lat), 46.8426065, 1e-7);
  EXPECT_NEAR(geo::degrees(at.lon), -91.9945599, 1e-7);
  EXPECT_NEAR(at.height_m, 198.31, 1e-6);
  EXPECT_NEAR(*flight->info().ground_height_m, 198.31 - 39.8, 1e-9);
  EXPECT_EQ(flight->info().datum, VerticalDatum::Unknown);
  EXPECT_NE(flight->info().datum_reason.find("above sea level"), std::string::npos);
  EXPECT_NEAR(*flight->at(0).raw->body_roll, geo::radians(3), 1e-12);
}

TEST(DroneJpegs, AFixedRtkPositionIsEllipsoidalAndAsGoodAsItSays) {
  const TemporaryFolder folder;
  Texts dji = gimbal("+10.00");
  dji.insert({{"RtkFlag", "50"}, {"RtkStdLat", "0.011"}, {"RtkStdLon", "0.013"}, {"RtkStdHgt", "0.024"}});
  dji.insert({"DewarpData", "2021-04-29;65.0,66.0,0.5,-0.25,-0.27,0.11,0.0008,-0.0004,-0.03"});
  writeJpeg(folder / "a.jpg", place("2021:06:23 16:31:59"), dji);
  const auto flight = importFlight(folder.path()).value();
  EXPECT_EQ(flight.info().datum, VerticalDatum::Ellipsoid);
  const Frame& frame = flight.at(0).frame;
  EXPECT_NEAR(std::sqrt(frame.pose->covariance(0, 0)), 0.013, 1e-12);  // east
  EXPECT_NEAR(std::sqrt(frame.pose->covariance(1, 1)), 0.011, 1e-12);  // north
  EXPECT_NEAR(std::sqrt(frame.pose->covariance(2, 2)), 0.024, 1e-12);
  EXPECT_DOUBLE_EQ(frame.camera.fx, 65.0);
  EXPECT_DOUBLE_EQ(frame.camera.cx, 40.5);
  EXPECT_EQ(frame.camera.distortion, (std::vector<double>{-0.27, 0.11, 0.0008, -0.0004, -0.03}));
}

TEST(DroneJpegs, Pix4dCameraTagsCountPitchFromStraightDown) {
  const TemporaryFolder folder;
  writeJpeg(folder / "a.jpg", place("2021:06:23 16:31:59"), {},
            {{"Yaw", "30.0"},
             {"Pitch", "0.0"},
             {"Roll", "0.0"},
             {"GPSXYAccuracy", "1.5"},
             {"VertCS", "ellipsoidal"}});
  const auto flight = importFlight(folder.path()).value();
  EXPECT_EQ(flight.info().datum, VerticalDatum::Ellipsoid);
  const Pose& pose = *flight.at(0).frame.pose;
  const Eigen::Vector3d down = -pose.position_in_ecef.normalized();
  EXPECT_GT((pose.ecef_from_camera * Eigen::Vector3d::UnitZ()).dot(down), 0.99999);
  EXPECT_NEAR(std::sqrt(pose.covariance(0, 0)), 1.5, 1e-12);
}

TEST(DroneJpegs, OneSecondHoldsSeveralImagesInTheOrderOfTheirNames) {
  const TemporaryFolder folder;
  for (const char* name : {"c.jpg", "a.jpg", "b.jpg"}) {
    writeJpeg(folder / name, place("2021:06:23 16:31:59"), gimbal("+1.00"));
  }
  const auto flight = importFlight(folder.path()).value();
  ASSERT_EQ(flight.size(), 3u);
  EXPECT_EQ(flight.at(0).frame.name, "a.jpg");
  EXPECT_EQ(flight.at(2).frame.name, "c.jpg");
  EXPECT_LT(flight.at(2).frame.time_ns - flight.at(0).frame.time_ns, 1'000'000'000);
}

TEST(DroneJpegs, WithoutAttitudeThereIsNoPoseAndWithoutTagsAReason) {
  const TemporaryFolder folder;
  writeJpeg(folder / "a.jpg", place("2021:06:23 16:31:59"), {});
  writeJpeg(folder / "b.jpg", {}, {});
  std::ofstream(folder / "c.jpg") << "no picture";
  const auto flight = importFlight(folder.path()).value();
  ASSERT_EQ(flight.size(), 1u);
  EXPECT_FALSE(flight.at(0).frame.pose);
  EXPECT_TRUE(flight.at(0).raw->lat);
  EXPECT_EQ(flight.skipped(), 2u);
  EXPECT_EQ(flight.warnings().size(), 2u);
}

TEST(DroneJpegs, DamagedTagsAreSkippedOrRead) {
  const TemporaryFolder folder(true);
  writeJpeg(folder / "good.jpg", place("2021:06:23 16:31:59"), gimbal("+1.00"));
  std::ifstream in(folder / "good.jpg", std::ios::binary);
  const std::string good{std::istreambuf_iterator<char>(in), {}};
  for (unsigned seed = 0; seed < 300; ++seed) {
    std::mt19937 random(seed);
    std::string bad = good;
    for (int i = 0; i < 6; ++i) bad[random() % 1500] = static_cast<char>(random());
    if (seed % 5 == 0) bad.resize(random() % bad.size());
    std::ofstream(folder / "good.jpg", std::ios::binary) << bad;
    const auto flight = importFlight(folder.path());
    if (!flight) {
      EXPECT_GT(flight.error().message.size(), 15u) << seed;
    } else if (const auto frame = flight->load(0); frame && (*frame)->pose) {
      EXPECT_TRUE((*frame)->pose->position_in_ecef.allFinite()) << seed;
    }
  }
}

// Yaw, pitch and roll as a device speaks them have a pole exactly where mapping cameras look: no step of a
// tenth of a degree in yaw may turn the camera by more or less than that, around straight down and beyond it.
TEST(DeviceAttitude, StraightDownAtEveryYawTurnsWithoutAJump) {
  for (const double pitch_deg : {-90.0, -89.9, -90.1, -60.0}) {
    std::optional<Pose> before;
    for (int step = -3600; step <= 3600; ++step) {
      RawTelemetry raw;
      raw.lat = 0.8;
      raw.lon = 3.14159;  // beside the antimeridian
      raw.altitude_m = 100;
      raw.gimbal_yaw = geo::radians(step / 10.0);
      raw.gimbal_pitch = geo::radians(pitch_deg);
      raw.gimbal_roll = 0;
      const auto pose = devicePose(raw, 0);
      ASSERT_TRUE(pose);
      ASSERT_NEAR(pose->ecef_from_camera.norm(), 1, 1e-14);
      if (before) {
        ASSERT_NEAR(geo::degrees(pose->ecef_from_camera.angularDistance(before->ecef_from_camera)), 0.1, 1e-6)
            << pitch_deg << " " << step;
      }
      before = pose;
      // And the image's top points where yaw says.
      const Eigen::Matrix3d enu = geo::LocalFrame({0.8, 3.14159, 100}).enuFromEcefRotation();
      const Eigen::Vector3d top = enu * (pose->ecef_from_camera * -Eigen::Vector3d::UnitY());
      if (pitch_deg > -90.05) {
        ASSERT_NEAR(std::remainder(geo::degrees(std::atan2(top.x(), top.y())) - step / 10.0, 360), 0, 1e-6);
      }
      const auto angles = geo::yawPitchRoll(Eigen::Quaterniond(enu) * pose->ecef_from_camera);
      const Eigen::Quaterniond again = geo::enuFromCamera(angles.yaw, angles.pitch, angles.roll);
      ASSERT_LT(again.angularDistance(Eigen::Quaterniond(enu) * pose->ecef_from_camera), 1e-7);
    }
  }
}

}  // namespace
}  // namespace overfly::capture
