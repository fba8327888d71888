#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>

#include "tests/vm/guest.h"

// The camera sources on the kernel's own drivers.
namespace overfly::vm {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

class Cameras : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string reason = Guest::whyNot(); !reason.empty()) GTEST_SKIP() << reason;
    guest_ = std::make_unique<Guest>();
  }
  std::unique_ptr<Guest> guest_;
};

// In one boot, which takes longer than all of it.
TEST_F(Cameras, PassTheComplianceSuiteOfFrameSources) {
  const auto vivid = guest_->run("modprobe vivid n_devs=1 && udevadm settle && test -e /dev/video0", 120s);
  ASSERT_EQ(vivid.status, 0) << vivid.output;
  const auto v4l2 = guest_->run(
      "OVERFLY_V4L2_DEVICE=/dev/video0 /mnt/host/tests/unit/v4l2/test_v4l2 --gtest_filter='*Device*'", 300s);
  EXPECT_EQ(v4l2.status, 0) << v4l2.output;
  EXPECT_THAT(v4l2.output, HasSubstr("FrameSourceCompliance.FramesKeepTheSourcesPace/Device ("));
  EXPECT_THAT(v4l2.output, testing::Not(HasSubstr("SKIPPED"))) << v4l2.output;

  // vimc is libcamera's own test camera.
  const auto vimc = guest_->run("modprobe vimc && udevadm settle && cam -l", 120s);
  ASSERT_EQ(vimc.status, 0) << vimc.output;
  ASSERT_THAT(vimc.output, HasSubstr("Sensor B"));
  const auto libcamera = guest_->run(
      "OVERFLY_LIBCAMERA_DEVICE=\"$(cam -l | sed -n 's/.*(\\(.*\\)).*/\\1/p' | head -n 1)\" "
      "/mnt/host/tests/unit/libcamera/test_libcamera --gtest_filter='*Device*'",
      300s);
  EXPECT_EQ(libcamera.status, 0) << libcamera.output;
  EXPECT_THAT(libcamera.output, HasSubstr("FrameSourceCompliance.FramesKeepTheSourcesPace/Device ("));
  EXPECT_THAT(libcamera.output, testing::Not(HasSubstr("SKIPPED"))) << libcamera.output;
}

}  // namespace
}  // namespace overfly::vm
