#include <cstdlib>
#include <vector>

#include "capture/v4l2/v4l2_source.h"
#include "tests/unit/capture/frame_source_compliance.h"
#include "tests/unit/v4l2/fake_kernel.h"

namespace overfly::capture {
namespace {

LiveCameraOptions optionsFor(const std::string& device, int width, int height) {
  LiveCameraOptions options;
  options.device = device;
  options.width = width;
  options.height = height;
  options.lens.width = width;
  options.lens.height = height;
  options.lens.fx = options.lens.fy = width;
  options.lens.cx = width / 2.0;
  options.lens.cy = height / 2.0;
  return options;
}

SourceKind fake(const std::string& name, bool planes) {
  SourceKind kind;
  kind.name = name;
  kind.make = [planes] {
    auto kernel = std::make_shared<v4l2::FakeKernel>();
    kernel->planes = planes;
    return std::make_unique<V4l2Source>(optionsFor("/dev/video0", 64, 48), kernel);
  };
  kind.make_absent = [] {
    return std::make_unique<V4l2Source>(optionsFor("/dev/video9", 64, 48),
                                        std::make_shared<v4l2::FakeKernel>());
  };
  kind.interval = std::chrono::milliseconds(5);
  return kind;
}

// OVERFLY_V4L2_DEVICE names a real camera that gives 640x480, as vivid's.
std::vector<SourceKind> kinds() {
  std::vector<SourceKind> kinds{fake("OnePlane", false), fake("Planes", true)};
  const char* device = std::getenv("OVERFLY_V4L2_DEVICE");
  if (device == nullptr) return kinds;
  SourceKind kind;
  kind.name = "Device";
  kind.make = [device] { return std::make_unique<V4l2Source>(optionsFor(device, 640, 480)); };
  kind.make_absent = [] {
    return std::make_unique<V4l2Source>(optionsFor("/dev/video-not-there", 640, 480));
  };
  kind.patience = std::chrono::milliseconds(10000);
  kinds.push_back(kind);
  return kinds;
}

INSTANTIATE_TEST_SUITE_P(V4l2, FrameSourceCompliance, testing::ValuesIn(kinds()), sourceKindName);

}  // namespace
}  // namespace overfly::capture
