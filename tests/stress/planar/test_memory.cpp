#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "capture/geo/footprint.h"
#include "capture/image_decode.h"
#include "capture/record/recorder.h"
#include "tests/stress/store/parameters.h"

namespace overfly::tiling {
namespace {

// A texel of zoom 21 at the equator; a frame of 1,024 x 768 pixels of that size covers 4 x 3 tiles.
constexpr double kTexel_m = 2 * 3.14159265358979323846 * 6378137 / 256 / 2097152;
constexpr int kTilesPerFrame = 12;

capture::Image picture() {
  capture::Image image;
  image.format = capture::PixelFormat::Rgb8;
  image.width = 1024;
  image.height = 768;
  image.stride = 3 * image.width;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      for (int c = 0; c < 3; ++c)
        image.bytes.push_back(static_cast<std::uint8_t>(
            120 + 50 * std::sin(0.11 * x + c) * std::cos(0.07 * y) + ((x * 7919 + y * 104729) >> 3) % 23));
  return *capture::encodeJpeg(image, 85);
}

// A flight that lies on a disk: lines of frames side by side over flat ground, without overlap.
void recordFlight(const std::filesystem::path& folder, int tiles) {
  capture::FlightInfo info;
  info.datum = capture::VerticalDatum::Ellipsoid;
  info.ground_height_m = 0;
  info.boot_id = "simulated";
  auto recorder = capture::FlightRecorder::create(folder, info);
  ASSERT_TRUE(recorder) << recorder.error().message;
  const geo::LocalFrame local({geo::radians(0.01), geo::radians(9.0), 0});
  const int frames = (tiles + kTilesPerFrame - 1) / kTilesPerFrame;
  const int per_line = std::max(4, static_cast<int>(std::sqrt(frames)));
  capture::Frame frame;
  frame.image = picture();
  frame.camera_id = "main";
  frame.camera.width = frame.image.width;
  frame.camera.height = frame.image.height;
  frame.camera.fx = frame.camera.fy = 50 / kTexel_m;
  frame.camera.cx = 512;
  frame.camera.cy = 384;
  frame.datum = capture::VerticalDatum::Ellipsoid;
  frame.pose_is_adjusted = true;
  for (int i = 0; i < frames; ++i) {
    frame.sequence = static_cast<std::uint64_t>(i);
    frame.name = std::to_string(1000000 + i) + ".jpg";
    frame.time_ns = 1'000'000'000LL * (i + 1);
    capture::Pose pose;
    pose.time_ns = frame.time_ns;
    pose.position_in_ecef =
        local.ecefFromEnu({1024 * kTexel_m * (i % per_line), 768 * kTexel_m * (i / per_line),
                           50});  // NOLINT(bugprone-integer-division)
    const geo::LocalFrame there(geo::geodeticFromEcef(pose.position_in_ecef));
    pose.ecef_from_camera = Eigen::Quaterniond(there.enuFromEcefRotation()).conjugate() *
                            geo::enuFromCamera(0, geo::radians(-90), 0);
    frame.pose = pose;
    ASSERT_TRUE(recorder->record(frame));
  }
  ASSERT_TRUE(recorder->close());
}

// Peak resident memory of the program that maps the flight, kilobytes; the number of tile updates it says.
long peakKilobytes(const std::filesystem::path& folder, int tiles, long& updates) {
  recordFlight(folder / "flight", tiles);
  const std::string program = OVERFLY_BINARY_DIR "/bin/overfly";
  const std::string flight = folder / "flight", map = folder / "map.overfly", out = folder / "out.json";
  const pid_t child = fork();
  if (child == 0) {
    const int file = open(out.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0644);
    dup2(file, STDOUT_FILENO);
    execl(program.c_str(), program.c_str(), "--json", "map", flight.c_str(), "-o", map.c_str(), "--planar",
          "--cache-mb", "32", nullptr);
    _exit(127);
  }
  int status = 0;
  rusage usage{};
  EXPECT_EQ(wait4(child, &status, 0, &usage), child);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  std::FILE* file = std::fopen(out.c_str(), "r");
  std::string text(4096, '\0');
  if (file != nullptr) {
    text.resize(std::fread(text.data(), 1, text.size(), file));
    std::fclose(file);
  }
  const auto at = text.find("\"tile_updates\": ");
  updates = at == std::string::npos ? 0 : std::strtol(text.c_str() + at + 16, nullptr, 10);
  std::filesystem::remove_all(folder);
  return usage.ru_maxrss;
}

TEST(PlanarMemory, DoesNotGrowWithTheMap) {
  const int many = static_cast<int>(parameter("OVERFLY_TILES", 1500));
  long few_updates = 0, many_updates = 0;
  const long small = peakKilobytes(stressFolder("planar-small"), 200, few_updates);
  const long large = peakKilobytes(stressFolder("planar-large"), many, many_updates);
  std::printf("peak RSS: %ld kB for %ld tile updates, %ld kB for %ld\n", small, few_updates, large,
              many_updates);
  EXPECT_GE(few_updates, 200);
  EXPECT_GE(many_updates, many);
  EXPECT_LT(std::abs(static_cast<double>(large - small)), 0.05 * static_cast<double>(small));
}

}  // namespace
}  // namespace overfly::tiling
