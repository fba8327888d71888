#include "capture/libcamera/libcamera_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <vector>

#include "tests/unit/capture/frame_source_compliance.h"

namespace overfly::capture {
namespace {

using testing::HasSubstr;

LiveCameraOptions optionsFor(const std::string& device) {
  LiveCameraOptions options;
  options.device = device;
  options.width = options.lens.width = 636;
  options.height = options.lens.height = 480;
  options.lens.fx = options.lens.fy = 600;
  options.lens.cx = 320;
  options.lens.cy = 240;
  options.buffers = 4;
  return options;
}

// OVERFLY_LIBCAMERA_DEVICE names a real camera, by id or model, that gives 636x480,
// as vimc's.
std::vector<SourceKind> kinds() {
  const char* device = std::getenv("OVERFLY_LIBCAMERA_DEVICE");
  if (device == nullptr) return {};
  SourceKind kind;
  kind.name = "Device";
  kind.make = [device] { return std::make_unique<LibcameraSource>(optionsFor(device)); };
  kind.make_absent = [] { return std::make_unique<LibcameraSource>(optionsFor("no such camera")); };
  kind.patience = std::chrono::milliseconds(20000);
  return {kind};
}

// Without a camera there is nothing to instantiate.
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(FrameSourceCompliance);
INSTANTIATE_TEST_SUITE_P(Libcamera, FrameSourceCompliance, testing::ValuesIn(kinds()), sourceKindName);

TEST(Libcamera, AnAbsentCameraIsUnavailableAndMayComeBack) {
  LibcameraSource source(optionsFor("no such camera"));
  for (int attempt = 0; attempt < 3; ++attempt) {
    const auto opened = source.open();
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ErrorCode::Unavailable);
    EXPECT_THAT(opened.error().message, HasSubstr("libcamera finds no camera"));
    EXPECT_EQ(source.status().problem, opened.error().message);
    EXPECT_FALSE(source.status().present);
  }
}

TEST(Libcamera, ItsVersionIsKnown) { EXPECT_THAT(libcameraVersion(), HasSubstr(".")); }

}  // namespace
}  // namespace overfly::capture
