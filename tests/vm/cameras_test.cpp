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
  EXPECT_THAT(v4l2.output, HasSubstr("[  PASSED  ] 9 tests"));
}

}  // namespace
}  // namespace overfly::vm
