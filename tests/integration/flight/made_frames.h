#pragma once
#include <fmt/format.h>
#include <stdlib.h>

#include <filesystem>
#include <random>

#include "capture/geo/geodetic.h"
#include "capture/image_decode.h"
#include "capture/record/flight.h"
#include "capture/record/recorder.h"

namespace overfly::capture::testing_data {

// A folder that is gone with its value.
class TemporaryFolder {
 public:
  // In memory where the machine has a folder for that, for tests that make thousands of files.
  explicit TemporaryFolder(bool in_memory = false) {
    const bool memory = in_memory && std::filesystem::is_directory("/dev/shm");
    const std::filesystem::path parent = memory ? "/dev/shm" : std::filesystem::temp_directory_path();
    std::string name = (parent / "overfly-test-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~TemporaryFolder() {
    std::error_code code;
    std::filesystem::remove_all(path_, code);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// Frame i of a made flight: the same for the same i in every process.
inline Frame madeFrame(std::uint64_t i, PixelFormat format = PixelFormat::Jpeg, int width = 64,
                       int height = 48) {
  std::mt19937_64 random(i);
  Image image;
  image.format = PixelFormat::Rgb8;
  image.width = width;
  image.height = height;
  image.stride = width * 3;
  image.bytes.resize(static_cast<std::size_t>(image.stride * height));
  for (std::uint8_t& byte : image.bytes) byte = static_cast<std::uint8_t>(random());
  Frame frame;
  frame.sequence = i;
  frame.name = fmt::format("{:08}.jpg", i);
  frame.camera_id = "main";
  frame.time_ns = 5'000'000'000 + static_cast<std::int64_t>(i) * 100'000'123;
  frame.utc_offset_ns = 1'700'000'000'123'456'789;
  frame.exposure_ns = 1'234'567;
  frame.gain = 1.7;
  frame.camera.kind = CameraModel::Kind::RadialTangential;
  frame.camera.width = width;
  frame.camera.height = height;
  frame.camera.fx = frame.camera.fy = width * 0.9123;
  frame.camera.cx = 0.5 * width + 0.1234;
  frame.camera.cy = 0.5 * height - 0.3;
  frame.camera.distortion = {-0.01, 0.002, 0.0001, 0.0003};
  frame.datum = VerticalDatum::Ellipsoid;
  Pose pose;
  pose.time_ns = frame.time_ns;
  pose.position_in_ecef = geo::ecefFromGeodetic(
      {0.81, 0.15 + 1e-7 * static_cast<double>(i), 480 + 0.1 * static_cast<double>(i % 7)});
  pose.ecef_from_camera =
      Eigen::Quaterniond(0.1, 0.7, 0.2 + 0.001 * static_cast<double>(i % 100), 0.3).normalized();
  pose.covariance.diagonal() << 0.01, 0.01, 0.04, 1e-4, 1e-4, 4e-4;
  if (i % 3 == 0) pose.covariance(0, 4) = pose.covariance(4, 0) = 1.2345e-5;
  if (i % 5 != 4) frame.pose = pose;
  frame.image = format == PixelFormat::Jpeg ? encodeJpeg(image, 80).value() : std::move(image);
  if (format == PixelFormat::Grey8) frame.image = decodeImage(frame.image, PixelFormat::Grey8).value();
  return frame;
}

inline bool same(const Frame& a, const Frame& b) {
  if (a.pose.has_value() != b.pose.has_value()) return false;
  if (a.pose && (a.pose->time_ns != b.pose->time_ns || a.pose->position_in_ecef != b.pose->position_in_ecef ||
                 a.pose->ecef_from_camera.coeffs() != b.pose->ecef_from_camera.coeffs() ||
                 a.pose->covariance != b.pose->covariance)) {
    return false;
  }
  return a.sequence == b.sequence && a.name == b.name && a.camera_id == b.camera_id &&
         a.time_ns == b.time_ns && a.utc_offset_ns == b.utc_offset_ns && a.exposure_ns == b.exposure_ns &&
         a.gain == b.gain && a.image.format == b.image.format && a.image.width == b.image.width &&
         a.image.height == b.image.height && a.image.stride == b.image.stride &&
         a.image.bytes == b.image.bytes && a.camera == b.camera && a.pose_is_adjusted == b.pose_is_adjusted &&
         a.datum == b.datum;
}

}  // namespace overfly::capture::testing_data
