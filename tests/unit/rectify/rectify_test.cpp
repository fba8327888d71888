#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <random>

#include "capture/image_decode.h"
#include "tests/unit/gl/gl_fixture.h"
#include "tiling/rectify/rectifier.h"

namespace overfly::tiling {
namespace {

using capture::CameraModel;
using capture::Frame;
using capture::Image;
using capture::PixelFormat;
using Eigen::Vector2d;

CameraModel cameraOf(CameraModel::Kind kind, std::vector<double> distortion) {
  CameraModel camera;
  camera.kind = kind;
  camera.width = 322;
  camera.height = 241;
  camera.fx = 262.5;
  camera.fy = 263.25;
  camera.cx = 158.7;
  camera.cy = 123.4;
  camera.distortion = std::move(distortion);
  return camera;
}

struct Lens {
  const char* name;
  CameraModel camera;
};

std::vector<Lens> lenses() {
  using Kind = CameraModel::Kind;
  return {
      {"pinhole", cameraOf(Kind::Pinhole, {})},
      {"brown4", cameraOf(Kind::RadialTangential, {-0.12, 0.03, 0.001, -0.0007})},
      {"brown5", cameraOf(Kind::RadialTangential, {-0.28, 0.11, -0.0006, 0.0011, -0.02})},
      {"brown8", cameraOf(Kind::RadialTangential, {0.21, -0.05, 0.0004, 0.0003, 0.01, 0.41, 0.02, 0.003})},
      {"pincushion", cameraOf(Kind::RadialTangential, {0.15, 0.02, 0.0, 0.0})},
      {"fisheye", cameraOf(Kind::Fisheye, {-0.02, 0.004, -0.001, 0.0002})},
  };
}

int channelsOf(PixelFormat format) {
  return format == PixelFormat::Grey8 || format == PixelFormat::Nv12 ? 1 : 3;
}

// White noise: the hardest image for a resampler.
Image noise(PixelFormat format, int width, int height, int padding, unsigned seed) {
  std::mt19937 random(seed);
  Image image;
  image.format = format;
  image.width = width;
  image.height = height;
  image.stride = width * channelsOf(format) + padding;
  const int rows = height + (format == PixelFormat::Nv12 ? (height + 1) / 2 : 0);
  image.bytes.resize(static_cast<std::size_t>(image.stride) * static_cast<std::size_t>(rows));
  for (auto& byte : image.bytes) byte = static_cast<std::uint8_t>(random());
  return image;
}

using Rgb = std::array<double, 3>;

// The picture in double, 0..255, by plain code that shares nothing with the shader.
class Reference {
 public:
  explicit Reference(const Image& image) : image_(image) {}

  [[nodiscard]] Rgb at(const Vector2d& pixel) const {
    if (image_.format == PixelFormat::Nv12) return nv12(pixel);
    Rgb out{};
    for (std::size_t c = 0; c < 3; ++c) {
      const int channel = image_.format == PixelFormat::Grey8  ? 0
                          : image_.format == PixelFormat::Bgr8 ? 2 - static_cast<int>(c)
                                                               : static_cast<int>(c);
      out[c] = plane(pixel, 0, image_.width, image_.height, channelsOf(image_.format), channel);
    }
    return out;
  }

 private:
  [[nodiscard]] double plane(const Vector2d& pixel, std::size_t begin, int width, int height, int step,
                             int channel) const {
    const double x = std::clamp(pixel.x() - 0.5, 0.0, width - 1.0),
                 y = std::clamp(pixel.y() - 0.5, 0.0, height - 1.0);
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const int x1 = std::min(x0 + 1, width - 1), y1 = std::min(y0 + 1, height - 1);
    const auto value = [&](int i, int j) {
      return static_cast<double>(
          image_.bytes[begin + static_cast<std::size_t>(j * image_.stride + i * step + channel)]);
    };
    const double a = value(x0, y0) * (x0 + 1 - x) + value(x1, y0) * (x - x0);
    const double b = value(x0, y1) * (x0 + 1 - x) + value(x1, y1) * (x - x0);
    return a * (y0 + 1 - y) + b * (y - y0);
  }
  [[nodiscard]] Rgb nv12(const Vector2d& pixel) const {
    const double luma = plane(pixel, 0, image_.width, image_.height, 1, 0);
    const auto begin = static_cast<std::size_t>(image_.stride * image_.height);
    const int w = (image_.width + 1) / 2, h = (image_.height + 1) / 2;
    const double u = plane(pixel / 2, begin, w, h, 2, 0) - 128, v = plane(pixel / 2, begin, w, h, 2, 1) - 128;
    return {std::clamp(luma + 1.402 * v, 0.0, 255.0),
            std::clamp(luma - 0.344136 * u - 0.714136 * v, 0.0, 255.0),
            std::clamp(luma + 1.772 * u, 0.0, 255.0)};
  }
  const Image& image_;
};

// Where OpenCV puts a point of the plane z = 1, in this project's pixels.
Vector2d byOpenCv(const CameraModel& camera, double x, double y) {
  const cv::Matx33d k(camera.fx, 0, camera.cx - 0.5, 0, camera.fy, camera.cy - 0.5, 0, 0, 1);
  std::vector<cv::Point2d> pixels;
  if (camera.kind == CameraModel::Kind::Fisheye) {
    cv::fisheye::distortPoints(std::vector<cv::Point2d>{{x, y}}, pixels, k, camera.distortion);
  } else {
    cv::projectPoints(std::vector<cv::Point3d>{{x, y, 1}}, cv::Vec3d(), cv::Vec3d(), k, camera.distortion,
                      pixels);
  }
  return {pixels[0].x + 0.5, pixels[0].y + 0.5};
}

struct Difference {
  double mean = 0;
  double p999 = 0;
  std::size_t count = 0;
};

Difference summary(std::vector<double> differences) {
  Difference out;
  out.count = differences.size();
  if (differences.empty()) return out;
  for (const double d : differences) out.mean += d;
  out.mean /= static_cast<double>(differences.size());
  std::sort(differences.begin(), differences.end());
  out.p999 = differences[static_cast<std::size_t>(0.999 * static_cast<double>(differences.size() - 1))];
  return out;
}

std::size_t index(int width, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
}

class Rectify : public test::GlTest {
 protected:
  static Frame frameOf(const CameraModel& camera, Image image) {
    Frame frame;
    frame.name = "test";
    frame.camera = camera;
    frame.image = std::move(image);
    return frame;
  }
};

// The bounds: 0.5/255 on average and 2/255 at the 99.9th percentile against the exact map in double.
TEST_F(Rectify, GpuAgreesWithResamplingInDoubleForEveryLensAndFormat) {
  OVERFLY_ASSERT_OK(rectifier, Rectifier::create(context()));
  unsigned seed = 1;
  for (const Lens& lens : lenses()) {
    for (const PixelFormat format :
         {PixelFormat::Grey8, PixelFormat::Rgb8, PixelFormat::Bgr8, PixelFormat::Nv12}) {
      SCOPED_TRACE(::testing::Message()
                   << lens.name << ", format " << static_cast<int>(format) << ", seed " << seed);
      const Frame frame = frameOf(lens.camera, noise(format, lens.camera.width, lens.camera.height,
                                                     format == PixelFormat::Nv12 ? 6 : 5, seed++));
      OVERFLY_ASSERT_OK(out, rectifier.rectify(7, frame));
      EXPECT_EQ(out.id, 7u);
      const int width = out.pinhole.width, height = out.pinhole.height;
      std::vector<std::uint8_t> color(index(width, 0, height) * 4), luma(index(width, 0, height));
      ASSERT_TRUE(out.color.download(std::span(color)));
      ASSERT_TRUE(out.luma.download(std::span(luma)));
      const Reference reference(frame.image);
      std::vector<double> color_off, luma_off;
      std::size_t wrongly_valid = 0, wrongly_invalid = 0, inside_count = 0;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const auto source = exactSourceFromPinhole(frame.camera, out.pinhole, {x + 0.5, y + 0.5});
          const auto within = [&](double margin) {
            return source && source->x() >= 0.5 + margin && source->y() >= 0.5 + margin &&
                   source->x() <= frame.camera.width - 0.5 - margin &&
                   source->y() <= frame.camera.height - 0.5 - margin;
          };
          const std::size_t i = index(width, x, y);
          const bool valid = color[4 * i + 3] == 255;
          inside_count += within(0) ? 1 : 0;
          wrongly_valid += valid && !within(-0.05) ? 1 : 0;
          wrongly_invalid += !valid && within(0.05) ? 1 : 0;
          if (!valid || !source) continue;
          const Rgb wanted = reference.at(*source);
          for (std::size_t c = 0; c < 3; ++c) color_off.push_back(std::abs(color[4 * i + c] - wanted[c]));
          luma_off.push_back(
              std::abs(luma[i] - (0.212671 * wanted[0] + 0.715160 * wanted[1] + 0.072169 * wanted[2])));
        }
      }
      EXPECT_EQ(wrongly_valid, 0u);
      // Cells that reach beyond the lens model's domain are given up whole: a rim only there.
      EXPECT_LE(static_cast<double>(wrongly_invalid), 0.002 * static_cast<double>(inside_count));
      const Difference c = summary(color_off), l = summary(luma_off);
      RecordProperty(std::string(lens.name) + std::to_string(static_cast<int>(format)),
                     std::to_string(c.mean) + " " + std::to_string(c.p999));
      EXPECT_GT(l.count, static_cast<std::size_t>(frame.camera.width * frame.camera.height) / 2);
      EXPECT_LE(c.mean, 0.5);
      EXPECT_LE(c.p999, 2.0);
      EXPECT_LE(l.mean, 0.5);
      EXPECT_LE(l.p999, 2.0);
    }
  }
}

TEST(Undistortion, MapIsOpenCvs) {
  for (const Lens& lens : lenses()) {
    SCOPED_TRACE(lens.name);
    const auto map = planUndistortion(lens.camera);
    ASSERT_TRUE(map.has_value()) << map.error().message;
    const CameraModel& pinhole = map->pinhole;
    for (int i = 0; i < 200; ++i) {
      const Vector2d pixel(pinhole.width * (0.1 + 0.8 * (i % 20) / 19.0),
                           pinhole.height * (0.1 + 0.8 * (i / 20) / 9.0));
      const auto mapped = map->sourceFromPinhole(pixel);
      if (!mapped) continue;
      const Vector2d wanted =
          byOpenCv(lens.camera, (pixel.x() - pinhole.cx) / pinhole.fx, (pixel.y() - pinhole.cy) / pinhole.fy);
      if (wanted.x() < 0 || wanted.y() < 0 || wanted.x() > lens.camera.width ||
          wanted.y() > lens.camera.height)
        continue;
      EXPECT_LT((*mapped - wanted).norm(), 0.005);
    }
  }
}

TEST(Undistortion, PinholeImageHoldsTheWholeSourceAtTheSameFocalLength) {
  for (const Lens& lens : lenses()) {
    SCOPED_TRACE(lens.name);
    const auto map = planUndistortion(lens.camera);
    ASSERT_TRUE(map.has_value());
    const CameraModel& pinhole = map->pinhole;
    EXPECT_EQ(pinhole.kind, CameraModel::Kind::Pinhole);
    EXPECT_FALSE(pinhole.problem().has_value());
    EXPECT_DOUBLE_EQ(pinhole.fx, lens.camera.fx);
    EXPECT_EQ(pinhole.width % 16, 0);
    EXPECT_EQ(pinhole.height % 16, 0);
    for (const Vector2d& corner :
         {Vector2d(1, 1), Vector2d(lens.camera.width - 1, 1), Vector2d(1, lens.camera.height - 1),
          Vector2d(lens.camera.width - 1, lens.camera.height - 1)}) {
      const auto ray = lens.camera.unproject(corner);
      ASSERT_TRUE(ray.has_value());
      const auto pixel = pinhole.project(*ray);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_GE(pixel->x(), 0);
      EXPECT_GE(pixel->y(), 0);
      EXPECT_LE(pixel->x(), pinhole.width);
      EXPECT_LE(pixel->y(), pinhole.height);
    }
  }
}

TEST(Undistortion, AWideFisheyeIsCutAtTheGrowthLimitAndAHugeOneAtTheDevices) {
  CameraModel camera = cameraOf(CameraModel::Kind::Fisheye, {0, 0, 0, 0});
  camera.fx = camera.fy = 100;  // 184 degrees across
  UndistortionOptions options;
  const auto wide = planUndistortion(camera, options);
  ASSERT_TRUE(wide.has_value());
  EXPECT_LE(wide->pinhole.width, 1.5 * camera.width + 32);
  EXPECT_GE(wide->pinhole.width, 1.4 * camera.width);
  EXPECT_DOUBLE_EQ(wide->pinhole.fx, 100);
  options.max_side = 256;
  const auto small = planUndistortion(camera, options);
  ASSERT_TRUE(small.has_value());
  EXPECT_LE(std::max(small->pinhole.width, small->pinhole.height), 256);
  EXPECT_LT(small->pinhole.fx, 100);
  camera.fx = 0;
  EXPECT_EQ(planUndistortion(camera).error().code, ErrorCode::BadInput);
}

TEST_F(Rectify, UndistortedCameraIsCopiedPixelByPixel) {
  const CameraModel camera = cameraOf(CameraModel::Kind::Pinhole, {});
  OVERFLY_ASSERT_OK(rectifier, Rectifier::create(context()));
  const Frame frame = frameOf(camera, noise(PixelFormat::Grey8, camera.width, camera.height, 0, 3));
  OVERFLY_ASSERT_OK(out, rectifier.rectify(1, frame));
  EXPECT_DOUBLE_EQ(out.pinhole.cx, camera.cx);
  EXPECT_DOUBLE_EQ(out.pinhole.cy, camera.cy);
  std::vector<std::uint8_t> luma(index(out.pinhole.width, 0, out.pinhole.height));
  ASSERT_TRUE(out.luma.download(std::span(luma)));
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      ASSERT_EQ(luma[index(out.pinhole.width, x, y)], frame.image.bytes[index(camera.width, x, y)])
          << x << " " << y;
    }
  }
}

TEST_F(Rectify, StatisticsAreThoseOfThePicture) {
  const CameraModel camera = cameraOf(CameraModel::Kind::Pinhole, {});
  OVERFLY_ASSERT_OK(rectifier, Rectifier::create(context()));
  Image image = noise(PixelFormat::Grey8, camera.width, camera.height, 0, 4);
  double sum = 0, square = 0;
  for (const auto byte : image.bytes) {
    sum += byte / 255.0;
    square += byte / 255.0 * byte / 255.0;
  }
  const auto count = static_cast<double>(image.bytes.size());
  OVERFLY_ASSERT_OK(out, rectifier.rectify(1, frameOf(camera, image)));
  EXPECT_NEAR(out.stats.mean, sum / count, 0.01);
  EXPECT_NEAR(out.stats.deviation, std::sqrt(square / count - sum / count * sum / count), 0.01);
  // White noise: the Laplacian has (16 + 4) times its variance.
  EXPECT_NEAR(out.stats.sharpness, std::sqrt(20.0) * out.stats.deviation, 0.03);
  EXPECT_NEAR(out.stats.valid, count / (out.pinhole.width * out.pinhole.height), 0.03);
  std::fill(image.bytes.begin(), image.bytes.end(), std::uint8_t{51});
  OVERFLY_ASSERT_OK(flat, rectifier.rectify(1, frameOf(camera, image)));
  EXPECT_NEAR(flat.stats.mean, 0.2, 1e-6);
  EXPECT_NEAR(flat.stats.deviation, 0, 1e-4);
  EXPECT_NEAR(flat.stats.sharpness, 0, 1e-6);
}

TEST_F(Rectify, QuadsHoldTheNeighbourhoodOnEveryLevel) {
  RectifyOptions options;
  options.quads = true;
  OVERFLY_ASSERT_OK(rectifier, Rectifier::create(context(), options));
  const CameraModel camera = cameraOf(CameraModel::Kind::Pinhole, {});
  OVERFLY_ASSERT_OK(
      out,
      rectifier.rectify(1, frameOf(camera, noise(PixelFormat::Grey8, camera.width, camera.height, 0, 5))));
  ASSERT_EQ(out.quads.spec().levels, out.luma.spec().levels);
  for (int level = 0; level < out.luma.spec().levels; ++level) {
    const int width = out.luma.width(level), height = out.luma.height(level);
    std::vector<std::uint8_t> luma(index(width, 0, height)), quads(index(width, 0, height) * 4);
    ASSERT_TRUE(out.luma.download(std::span(luma), level));
    ASSERT_TRUE(out.quads.download(std::span(quads), level));
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        for (int k = 0; k < 4; ++k) {
          ASSERT_EQ(quads[4 * index(width, x, y) + static_cast<std::size_t>(k)],
                    luma[index(width, std::min(x + k % 2, width - 1), std::min(y + k / 2, height - 1))])
              << "level " << level << ", " << x << " " << y << " " << k;
        }
      }
    }
  }
}

TEST_F(Rectify, JpegIsDecodedFirst) {
  const CameraModel camera = cameraOf(CameraModel::Kind::Pinhole, {});
  Image smooth = noise(PixelFormat::Rgb8, camera.width, camera.height, 0, 6);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width * 3; ++x) {
      smooth.bytes[static_cast<std::size_t>(y * smooth.stride + x)] =
          static_cast<std::uint8_t>(40 + x % 3 * 60 + y / 4);
    }
  }
  const auto jpeg = capture::encodeJpeg(smooth, 95);
  ASSERT_TRUE(jpeg.has_value());
  OVERFLY_ASSERT_OK(rectifier, Rectifier::create(context()));
  OVERFLY_ASSERT_OK(out, rectifier.rectify(1, frameOf(camera, *jpeg)));
  std::vector<std::uint8_t> color(index(out.pinhole.width, 0, out.pinhole.height) * 4);
  ASSERT_TRUE(out.color.download(std::span(color)));
  for (const int y : {10, 100, 200}) {
    const std::size_t i = 4 * index(out.pinhole.width, 50, y);
    EXPECT_NEAR(color[i], 40 + y / 4, 6);
    EXPECT_NEAR(color[i + 2], 160 + y / 4, 6);
  }
}

TEST_F(Rectify, UnusableFramesAreBadInput) {
  const CameraModel camera = cameraOf(CameraModel::Kind::Pinhole, {});
  OVERFLY_ASSERT_OK(rectifier, Rectifier::create(context()));
  const auto codeOf = [&](const CameraModel& model, Image image) {
    const auto out = rectifier.rectify(1, frameOf(model, std::move(image)));
    return out ? ErrorCode::Internal : out.error().code;
  };
  EXPECT_EQ(codeOf(camera, {}), ErrorCode::BadInput);
  EXPECT_EQ(codeOf(camera, noise(PixelFormat::Rgb8, 100, 100, 0, 1)), ErrorCode::BadInput);
  Image cut = noise(PixelFormat::Rgb8, camera.width, camera.height, 0, 1);
  cut.bytes.resize(1000);
  EXPECT_EQ(codeOf(camera, cut), ErrorCode::BadInput);
  CameraModel broken = camera;
  broken.fx = std::nan("");
  EXPECT_EQ(codeOf(broken, noise(PixelFormat::Rgb8, camera.width, camera.height, 0, 1)), ErrorCode::BadInput);
}

}  // namespace
}  // namespace overfly::tiling
