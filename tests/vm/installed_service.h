#pragma once
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>

#include "tests/vm/guest.h"

// The Debian package, installed in a guest under systemd with the kernel's own camera.
namespace overfly::vm {

// Made once in a process from what is built; lies in the build folder, which the guest sees.
inline bool makePackage() {
  static const bool made = std::system("cd '" OVERFLY_BINARY_DIR
                                       "' && mkdir -p vm && "
                                       "cpack -G DEB -B vm >vm/cpack.log 2>&1 && "
                                       "mv vm/overfly_*.deb vm/overfly.deb") == 0;
  return made;
}

inline constexpr const char* kCamera = "/dev/v4l/by-path/platform-vivid.0-video-index0";

class InstalledService : public testing::Test {
 protected:
  // `width`, `height`: of the pictures, five a second. `more`: further settings, TOML.
  void install(int width, int height, const std::string& more = {}, std::uint64_t disk_bytes = 2ULL << 30) {
    ASSERT_TRUE(makePackage()) << "cpack failed: see " OVERFLY_BINARY_DIR "/vm/cpack.log";
    std::string name = (std::filesystem::temp_directory_path() / "overfly_vm_disk_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
    disk_bytes_ = disk_bytes;
    boot();
    const std::string w = std::to_string(width), h = std::to_string(height);
    // Focal length: as wide as the picture.
    const auto installed = guest_->run(
        "set -e\n"
        "modprobe vivid n_devs=1\n"
        "udevadm settle\n"
        "test -e " +
            std::string(kCamera) +
            "\n"
            "mkdir -p /etc/overfly/conf.d\n"
            "cat >/etc/overfly/camera.json <<'JSON'\n"
            R"({"model": "PINHOLE", "width": )" +
            w + R"(, "height": )" + h + R"(, "fx": )" + w + R"(, "fy": )" + w + R"(, "cx": )" +
            std::to_string(width / 2) + R"(, "cy": )" + std::to_string(height / 2) +
            "}\nJSON\n"
            "cat >/etc/overfly/conf.d/50-camera.toml <<'TOML'\n"
            "[source]\nkind = \"v4l2\"\npath = \"" +
            kCamera +
            "\"\nretry_s = 0.5\n"
            "[camera]\nmodel_file = \"/etc/overfly/camera.json\"\nwidth_px = " +
            w + "\nheight_px = " + h +
            "\nrate_fps = 5\n"
            "[link]\nlisten = \"0.0.0.0\"\nport = 8420\nrequire_token = false\nTOML\n"
            "cat >/etc/overfly/conf.d/60-more.toml <<'TOML'\n" +
            more +
            "\nTOML\n"
            "DEBIAN_FRONTEND=noninteractive dpkg -i /mnt/host/vm/overfly.deb\n"
            "systemctl is-active overflyd\n",
        std::chrono::seconds(300));
    ASSERT_EQ(installed.status, 0) << installed.output << journal();
  }
  void SetUp() override {
    if (const std::string reason = Guest::whyNot(); !reason.empty()) GTEST_SKIP() << reason;
  }
  void TearDown() override {
    guest_.reset();
    std::error_code ignored;
    if (!folder_.empty()) std::filesystem::remove_all(folder_, ignored);
  }
  void boot() { guest_ = std::make_unique<Guest>(folder_ / "disk.img", disk_bytes_); }

  // Frames that are on the disk: lines of all tables of all missions.
  int recorded() {
    const auto count = guest_->run(kRecorded);
    return count.status == 0 ? std::atoi(count.output.c_str()) : -1;
  }
  // Until so many frames are recorded.
  bool waitForFrames(int wanted, std::chrono::seconds limit) {
    const auto until = std::chrono::steady_clock::now() + limit;
    while (recorded() < wanted) {
      if (std::chrono::steady_clock::now() > until) return false;
      guest_->run("sleep 0.5");
    }
    return true;
  }
  std::string journal() { return guest_->run("journalctl -u overflyd -n 40 --no-pager").output; }
  [[nodiscard]] std::string url() const { return "http://127.0.0.1:" + std::to_string(guest_->linkPort()); }

  static constexpr const char* kRecorded =
      "cat /var/lib/overfly/map/*/flight-*/frames.tbl 2>/dev/null | wc -l";
  std::filesystem::path folder_;
  std::uint64_t disk_bytes_ = 0;
  std::unique_ptr<Guest> guest_;
};

}  // namespace overfly::vm
