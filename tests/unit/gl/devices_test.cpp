#include "render/gl/devices.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "render/gl/context.h"

namespace overfly::gl {
namespace {

using ::testing::HasSubstr;

const std::vector<Device> kThree{{"/dev/dri/renderD128", "AMD Radeon Graphics (radeonsi, renoir)", false, {}},
                                 {"/dev/dri/renderD129", "", false, "no EGL display"},
                                 {"", "llvmpipe (LLVM 15.0.6, 256 bits)", true, {}}};

TEST(Devices, AreMeantByNumberNodeOrPartOfTheirName) {
  EXPECT_EQ(pickDevice(kThree, "0"), 0u);
  EXPECT_EQ(pickDevice(kThree, "2"), 2u);
  EXPECT_EQ(pickDevice(kThree, "/dev/dri/renderD129"), 1u);
  EXPECT_EQ(pickDevice(kThree, "radeon"), 0u);
  EXPECT_EQ(pickDevice(kThree, "LLVMpipe"), 2u);
}

TEST(Devices, WhatIsNotThereIsNobody) {
  for (const auto* wanted : {"3", "-1", "128", "/dev/dri/renderD130", "/dev/dri/renderD12", "nvidia", ""})
    EXPECT_EQ(pickDevice(kThree, wanted), std::nullopt) << wanted;
  EXPECT_EQ(pickDevice({}, "0"), std::nullopt);
}

TEST(Devices, ALinkMeansTheNodeThatItLeadsTo) {
  const auto folder = std::filesystem::temp_directory_path() / "overfly-devices-test";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  const auto node = folder / "node", link = folder / "pci-0000:00:02.0-render";
  std::filesystem::create_symlink("/dev/null", node);
  std::filesystem::create_symlink(node, link);
  EXPECT_EQ(pickDevice(std::vector<Device>{{"", "llvmpipe", true, {}}, {"/dev/null", "V3D 4.2", false, {}}},
                       link.string()),
            1u);
  std::filesystem::remove_all(folder);
}

TEST(Devices, AreDescribedByWhatTheyAreChosenBy) {
  EXPECT_THAT(describe(kThree),
              ::testing::ElementsAre("0: AMD Radeon Graphics (radeonsi, renoir) (/dev/dri/renderD128)",
                                     "1: unusable, no EGL display (/dev/dri/renderD129)",
                                     "2: llvmpipe (LLVM 15.0.6, 256 bits)"));
}

TEST(Devices, OfThisMachineCanEachBeOpenedByNumberAndName) {
  const auto devices = listDevices();
  ASSERT_FALSE(devices.empty());
  for (std::size_t i = 0; i < devices.size(); ++i) {
    if (!devices[i].problem.empty()) continue;
    ContextOptions options;
    options.device = std::to_string(i);
    const auto numbered = Context::create(options);
    ASSERT_TRUE(numbered) << numbered.error().message;
    EXPECT_EQ(numbered->info().renderer, devices[i].renderer);
    EXPECT_EQ(numbered->info().node, devices[i].node);
    options.device = devices[i].renderer;
    const auto named = Context::create(options);
    ASSERT_TRUE(named) << named.error().message;
    EXPECT_EQ(named->info().renderer, devices[i].renderer);
  }
}

TEST(Devices, OneThatIsNotHereIsRefusedWithThoseThatAre) {
  for (const auto* wanted : {"99", "/dev/dri/renderD200", "no such GPU"}) {
    ContextOptions options;
    options.device = wanted;
    const auto made = Context::create(options);
    ASSERT_FALSE(made) << wanted;
    EXPECT_EQ(made.error().code, ErrorCode::BadSettings);
    EXPECT_THAT(made.error().message, HasSubstr(wanted));
    for (const auto& line : describe(listDevices())) EXPECT_THAT(made.error().message, HasSubstr(line));
  }
}

}  // namespace
}  // namespace overfly::gl
