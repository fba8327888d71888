#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "tests/integration/daemon/daemon_process.h"

namespace overfly::test {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

// The Debian package as CPack makes it of the built programs.
TEST(Package, HoldsWhatAMachineNeedsAndNothingOfTheTests) {
  for (const char* tool : {"cpack", "dpkg-deb", "dpkg-shlibdeps", "file"})
    if (shell(fmt::format("command -v {}", tool)).status != 0) GTEST_SKIP() << tool << " is not here";
  std::string folder = (fs::temp_directory_path() / "overfly_package_XXXXXX").string();
  ASSERT_NE(mkdtemp(folder.data()), nullptr);
  const struct Remove {
    fs::path path;
    ~Remove() { fs::remove_all(path); }
  } remove{folder};
  const Outcome packed =
      shell(fmt::format("cpack -G DEB --config '{}/CPackConfig.cmake' -B '{}'", OVERFLY_BINARY_DIR, folder));
  ASSERT_EQ(packed.status, 0) << packed.output;
  std::vector<fs::path> packages;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".deb") packages.push_back(entry.path());
  ASSERT_EQ(packages.size(), 1u);
  EXPECT_THAT(packages[0].filename().string(), ContainsRegex("^overfly_[0-9.]+_[a-z0-9]+\\.deb$"));

  const std::string content = shell(fmt::format("dpkg-deb -c '{}'", packages[0].string())).output;
  for (const char* file :
       {"./usr/bin/overfly\n", "./usr/bin/overflyd\n", "./usr/lib/systemd/system/overflyd.service\n",
        "./usr/lib/sysusers.d/overfly.conf\n", "./usr/lib/tmpfiles.d/overfly.conf\n",
        "./usr/lib/udev/rules.d/70-overfly.rules\n", "./etc/overfly/overfly.toml\n",
        "./etc/overfly/conf.d/\n", "./usr/share/doc/overfly/copyright\n",
        "./usr/share/doc/overfly/deployment.md\n", "./usr/share/overfly/scenes/village.toml\n"})
    EXPECT_THAT(content, HasSubstr(file));
  for (const char* nothing : {"/usr/local/", "test_", "/home/", "./usr/include/", ".a\n"})
    EXPECT_THAT(content, Not(HasSubstr(nothing)));

  const auto field = [&](const char* name) {
    return shell(fmt::format("dpkg-deb -f '{}' {}", packages[0].string(), name)).output;
  };
  EXPECT_EQ(field("Package"), "overfly\n");
  const std::string depends = field("Depends");
  for (const char* library : {"libsqlite3-0", "libmicrohttpd12", "libegl", "libgl1-mesa-dri", "systemd"})
    EXPECT_THAT(depends, HasSubstr(library));
  const std::string control = shell(fmt::format("dpkg-deb -I '{}'", packages[0].string())).output;
  for (const char* script : {"postinst", "prerm", "postrm", "conffiles"})
    EXPECT_THAT(control, HasSubstr(script));

  // The unit starts the program that the package brings, and its sample of settings is accepted by it.
  const fs::path root = fs::path(folder) / "root";
  ASSERT_EQ(shell(fmt::format("dpkg-deb -x '{}' '{}'", packages[0].string(), root.string())).status, 0);
  EXPECT_THAT(
      shell(fmt::format("cat '{}'", (root / "usr/lib/systemd/system/overflyd.service").string())).output,
      HasSubstr("ExecStart=/usr/bin/overflyd\n"));
  const Outcome check = shell(fmt::format("'{}' config check '{}'", (root / "usr/bin/overfly").string(),
                                          (root / "etc/overfly/overfly.toml").string()));
  EXPECT_EQ(check.status, 0) << check.output;
}

}  // namespace
}  // namespace overfly::test
