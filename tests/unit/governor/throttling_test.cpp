#include "daemon/governor/throttling.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace overfly::daemon {
namespace {

namespace fs = std::filesystem;

// A part of /sys as files.
class Sys {
 public:
  Sys() {
    std::string name = (fs::temp_directory_path() / "overfly_sys_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = name;
  }
  ~Sys() { fs::remove_all(path_); }
  Sys(const Sys&) = delete;
  Sys& operator=(const Sys&) = delete;
  void put(const std::string& file, const std::string& text) const {
    fs::create_directories((path_ / file).parent_path());
    std::ofstream(path_ / file) << text << '\n';
  }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

TEST(Throttling, NothingKnownIsCool) {
  const Sys sys;
  EXPECT_EQ(readThrottling(sys.path()).headroom, 1);
  EXPECT_EQ(readThrottling("/there/is/no/such/folder").headroom, 1);
}

TEST(Throttling, CoolingDevicesAndTheFrequenciesThatTheyLeave) {
  const Sys sys;
  sys.put("class/thermal/cooling_device0/type", "cpufreq-cpu0");
  sys.put("class/thermal/cooling_device0/max_state", "4");
  sys.put("class/thermal/cooling_device0/cur_state", "0");
  sys.put("class/thermal/cooling_device1/type", "pwm-fan");  // a fan slows nothing down
  sys.put("class/thermal/cooling_device1/max_state", "4");
  sys.put("class/thermal/cooling_device1/cur_state", "4");
  EXPECT_EQ(readThrottling(sys.path()).headroom, 1);
  sys.put("class/thermal/cooling_device0/cur_state", "2");
  const Throttling guessed = readThrottling(sys.path());
  EXPECT_GT(guessed.headroom, 0.5);
  EXPECT_LT(guessed.headroom, 0.8);
  EXPECT_NE(guessed.reason.find("cpufreq-cpu0"), std::string::npos);
  sys.put("devices/system/cpu/cpufreq/policy0/cpuinfo_max_freq", "1500000");
  sys.put("devices/system/cpu/cpufreq/policy0/scaling_max_freq", "600000");
  EXPECT_NEAR(readThrottling(sys.path()).headroom, 0.4, 1e-9);
}

TEST(Throttling, AFirmwaresWord) {
  const Sys sys;
  sys.put("devices/platform/soc/soc:firmware/get_throttled", "50000");  // was so, is not now
  EXPECT_EQ(readThrottling(sys.path()).headroom, 1);
  sys.put("devices/platform/soc/soc:firmware/get_throttled", "50005");  // throttled now
  EXPECT_LT(readThrottling(sys.path()).headroom, 1);
}

TEST(Throttling, NonsenseIsLeftOut) {
  const Sys sys;
  sys.put("class/thermal/cooling_device0/type", "Processor");
  sys.put("class/thermal/cooling_device0/max_state", "zero");
  sys.put("class/thermal/cooling_device0/cur_state", "-3");
  sys.put("devices/platform/soc/soc:firmware/get_throttled", "");
  EXPECT_EQ(readThrottling(sys.path()).headroom, 1);
}

}  // namespace
}  // namespace overfly::daemon
