// Decoding, un-projection and pose interpolation, each beside OpenCV's own where it has one.
#include <benchmark/benchmark.h>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "capture/image_decode.h"
#include "capture/pose_track.h"

namespace {

using namespace overfly::capture;

const Image& jpeg() {
  static const Image image = [] {
    Image plain;
    plain.format = PixelFormat::Rgb8;
    plain.width = 1600;
    plain.height = 1200;
    plain.stride = 4800;
    plain.bytes.resize(4800 * 1200);
    std::uint32_t state = 1;
    for (std::size_t i = 0; i < plain.bytes.size(); ++i) {  // texture like soil: smooth with noise
      state = state * 1664525 + 1013904223;
      plain.bytes[i] = static_cast<std::uint8_t>(100 + (i / 3 % 1600) / 20 + (state >> 27));
    }
    return encodeJpeg(plain, 92).value();
  }();
  return image;
}

void pixels(benchmark::State& state) { state.SetItemsProcessed(state.iterations() * 1600 * 1200); }

void decode(benchmark::State& state, PixelFormat format, int divide) {
  for (auto _ : state) benchmark::DoNotOptimize(decodeImage(jpeg(), format, divide));
  pixels(state);
}
BENCHMARK_CAPTURE(decode, rgb, PixelFormat::Rgb8, 1)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(decode, grey, PixelFormat::Grey8, 1)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(decode, rgb_half, PixelFormat::Rgb8, 2)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(decode, rgb_eighth, PixelFormat::Rgb8, 8)->Unit(benchmark::kMillisecond);

void decodeOpenCv(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(cv::imdecode(jpeg().bytes, cv::IMREAD_COLOR));
  pixels(state);
}
BENCHMARK(decodeOpenCv)->Unit(benchmark::kMillisecond);

CameraModel lens() {
  CameraModel model;
  model.kind = CameraModel::Kind::RadialTangential;
  model.width = 1600;
  model.height = 1200;
  model.fx = model.fy = 1195.5;
  model.cx = 828.9;
  model.cy = 619.7;
  model.distortion = {-0.0128, 0.0053, 0.0030, 0.0060};
  return model;
}

void unproject(benchmark::State& state, std::vector<double> distortion, CameraModel::Kind kind) {
  CameraModel model = lens();
  model.kind = kind;
  model.distortion = std::move(distortion);
  int i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(model.unproject({i % 1600 + 0.5, i / 1600 % 1200 + 0.5}));
    i += 997;
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK_CAPTURE(unproject, pinhole, {}, CameraModel::Kind::Pinhole);
BENCHMARK_CAPTURE(unproject, radial_tangential_4, {-0.0128, 0.0053, 0.0030, 0.0060},
                  CameraModel::Kind::RadialTangential);
BENCHMARK_CAPTURE(unproject, radial_tangential_8, {0.42, -0.21, 0.0006, -0.0002, -0.03, 0.75, -0.15, -0.04},
                  CameraModel::Kind::RadialTangential);
BENCHMARK_CAPTURE(unproject, fisheye, {-0.021, 0.0093, -0.0071, 0.0011}, CameraModel::Kind::Fisheye);

void unprojectOpenCv(benchmark::State& state) {
  const CameraModel model = lens();
  const cv::Matx33d matrix(model.fx, 0, model.cx - 0.5, 0, model.fy, model.cy - 0.5, 0, 0, 1);
  std::vector<cv::Point2d> in(1000), out;
  for (int i = 0; i < 1000; ++i)
    in[static_cast<std::size_t>(i)] = {i * 997 % 1600 * 1.0, i * 997 / 1600 % 1200 * 1.0};
  const cv::TermCriteria exact(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 500, 1e-13);
  for (auto _ : state)
    cv::undistortPoints(in, out, matrix, model.distortion, cv::noArray(), cv::noArray(), exact);
  state.SetItemsProcessed(state.iterations() * 1000);
}
BENCHMARK(unprojectOpenCv);

void project(benchmark::State& state) {
  const CameraModel model = lens();
  double x = -0.5;
  for (auto _ : state) {
    benchmark::DoNotOptimize(model.project({x, 0.3, 1}));
    x = x > 0.5 ? -0.5 : x + 1e-4;
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(project);

void interpolatePose(benchmark::State& state) {
  PoseTrack track;
  for (int i = 0; i < 6000; ++i) {  // two minutes at 50 Hz
    Pose pose;
    pose.time_ns = i * std::int64_t{20'000'000};
    pose.position_in_ecef = {4157222.5 + 0.1 * i, 664789.3, 4774952.1};
    pose.ecef_from_camera = Eigen::AngleAxisd(0.001 * i, Eigen::Vector3d::UnitZ());
    if (!track.add(pose)) state.SkipWithError("a pose was refused");
  }
  CameraMount mount;
  mount.lever_arm_in_body = {0.1, 0, 0.05};
  std::int64_t time = 1'000'000'000;
  for (auto _ : state) {
    benchmark::DoNotOptimize(track.at(time, mount));
    time = 1'000'000'000 + (time * 7919 + 12345) % 118'000'000'000;
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(interpolatePose);

}  // namespace
