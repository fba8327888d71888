#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

// The service's files as systemd's own tools see them. Nothing is installed or started.
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;

const fs::path kFolder = fs::path(OVERFLY_SOURCE_DIR) / "systemd";
constexpr double kLargestExposure = 2.0;  // of 10; "OK" in systemd-analyze's words ends at 4

struct Outcome {
  int status = -1;
  std::string output;  // stdout and stderr
};

Outcome shell(const std::string& command) {
  Outcome out;
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (pipe == nullptr) return out;
  std::array<char, 4096> block{};
  while (const std::size_t bytes = std::fread(block.data(), 1, block.size(), pipe))
    out.output.append(block.data(), bytes);
  out.status = pclose(pipe);
  return out;
}

bool available(const std::string& program) { return shell("command -v " + program).status == 0; }

std::string textOf(const fs::path& file) {
  std::ifstream in(file);
  EXPECT_TRUE(in) << file;
  return {std::istreambuf_iterator<char>(in), {}};
}

// Lines that say something, without comments.
std::vector<std::string> directives(const std::string& text) {
  std::vector<std::string> out;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    if (!line.empty() && line.front() != '#' && line.front() != '[') out.push_back(line);
  return out;
}

class Service : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "overfly_systemd_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }

  // The unit with a program that exists on every machine, so that the verdict is about the unit alone.
  fs::path unitWith(const std::string& added = {}) {
    std::string text = textOf(kFolder / "overflyd.service");
    text = std::regex_replace(text, std::regex("ExecStart=\\S+"), "ExecStart=/bin/true");
    text = std::regex_replace(text, std::regex("\\[Service\\]"), "[Service]\n" + added);
    const fs::path file = folder_ / "overflyd.service";
    std::ofstream(file) << text;
    return file;
  }
  static Outcome verify(const fs::path& unit) {
    return shell("systemd-analyze verify --man=no '" + unit.string() + "'");
  }
  static double exposureOf(const fs::path& unit) {
    const Outcome out = shell("systemd-analyze security --offline=true --no-pager '" + unit.string() + "'");
    std::smatch match;
    if (!std::regex_search(out.output, match, std::regex("Overall exposure level[^:]*: ([0-9.]+)"))) {
      ADD_FAILURE() << out.output;
      return 10;
    }
    return std::stod(match[1]);
  }

  fs::path folder_;
};

TEST_F(Service, SystemdHasNothingToSayAgainstTheUnit) {
  if (!available("systemd-analyze")) GTEST_SKIP() << "systemd-analyze is not here (Debian package systemd)";
  const Outcome good = verify(unitWith());
  EXPECT_THAT(good.output, IsEmpty());
  EXPECT_EQ(good.status, 0);
  // that it would say something
  EXPECT_THAT(verify(unitWith("RestartSecs=1\n")).output, HasSubstr("RestartSecs"));
}

TEST_F(Service, TheSandboxLeavesLittleExposed) {
  if (!available("systemd-analyze")) GTEST_SKIP() << "systemd-analyze is not here (Debian package systemd)";
  EXPECT_LE(exposureOf(kFolder / "overflyd.service"), kLargestExposure);
  const fs::path open = folder_ / "open.service";
  std::ofstream(open) << "[Service]\nExecStart=/bin/true\n";
  EXPECT_GT(exposureOf(open), 9.0);
}

TEST_F(Service, TheSandboxLeavesDevicesAndTheSoftwareRasteriserAlone) {
  const std::vector<std::string> unit = directives(textOf(kFolder / "overflyd.service"));
  for (const std::string device : {"video4linux", "media", "drm", "dma_heap", "gpiochip"})
    EXPECT_THAT(unit, Contains("DeviceAllow=char-" + device + " rw"));
  EXPECT_THAT(unit, Not(Contains(StartsWith("PrivateDevices="))));
  EXPECT_THAT(unit, Not(Contains(StartsWith("MemoryDenyWriteExecute="))));
  EXPECT_THAT(unit, Contains(HasSubstr("MESA_SHADER_CACHE_DIR=%C/overfly")));
}

TEST_F(Service, ItIsRestartedForEverythingButWrongSettings) {
  const std::vector<std::string> unit = directives(textOf(kFolder / "overflyd.service"));
  for (const std::string line :
       {"Type=notify", "Restart=always", "RestartPreventExitStatus=2", "StartLimitIntervalSec=0",
        "StateDirectory=overfly", "CacheDirectory=overfly", "ConfigurationDirectory=overfly"})
    EXPECT_THAT(unit, Contains(line));
  EXPECT_THAT(unit, Contains(StartsWith("WatchdogSec=")));
}

TEST_F(Service, TheUserGetsTheGroupsThatOwnTheDevices) {
  if (!available("systemd-sysusers")) GTEST_SKIP() << "systemd-sysusers is not here (Debian package systemd)";
  if (geteuid() != 0) GTEST_SKIP() << "only root can make files for root";
  const fs::path root = folder_ / "root";
  fs::create_directories(root / "etc");
  const Outcome made = shell("systemd-sysusers --root='" + root.string() + "' '" +
                             (kFolder / "overfly.sysusers").string() + "'");
  ASSERT_EQ(made.status, 0) << made.output;
  EXPECT_THAT(textOf(root / "etc/passwd"), HasSubstr("overfly:x:"));
  std::vector<std::string> groups;
  std::istringstream lines(textOf(root / "etc/group"));
  for (std::string line; std::getline(lines, line);)
    if (line.ends_with(":overfly")) groups.push_back(line.substr(0, line.find(':')));
  EXPECT_THAT(groups, testing::UnorderedElementsAre("video", "render", "gpio", "dialout"));
}

TEST_F(Service, TheFoldersBelongToTheDaemon) {
  if (!available("systemd-tmpfiles")) GTEST_SKIP() << "systemd-tmpfiles is not here (Debian package systemd)";
  if (geteuid() != 0) GTEST_SKIP() << "only root can give folders away";
  const fs::path root = folder_ / "root";
  fs::create_directories(root / "etc");
  std::ofstream(root / "etc/passwd") << "overfly:x:4711:4712::/var/lib/overfly:/usr/sbin/nologin\n";
  std::ofstream(root / "etc/group") << "overfly:x:4712:\n";
  const Outcome made = shell("systemd-tmpfiles --root='" + root.string() + "' --create '" +
                             (kFolder / "overfly.tmpfiles").string() + "'");
  ASSERT_EQ(made.status, 0) << made.output;
  EXPECT_EQ(shell("stat -c '%a %u %g' '" + (root / "var/lib/overfly").string() + "'").output,
            "750 4711 4712\n");
  EXPECT_EQ(shell("stat -c '%a %u %g' '" + (root / "var/cache/overfly").string() + "'").output,
            "750 4711 4712\n");
}

TEST_F(Service, MaintainerScriptsCanBeParsed) {
  for (const std::string script : {"postinst", "prerm", "postrm"}) {
    const fs::path file = kFolder / "deb" / script;
    EXPECT_EQ(shell("sh -n '" + file.string() + "'").status, 0) << file;
    EXPECT_EQ(access(file.c_str(), X_OK), 0) << file;
  }
}

}  // namespace
