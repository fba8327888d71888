#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <random>
#include <thread>

#include "capture/image_decode.h"
#include "capture/record/flight.h"
#include "tests/integration/daemon/daemon_process.h"
#include "tests/integration/link/client.h"
#include "tiling/store/map_store.h"
#include "tiling/store/tile_codec.h"

// The built daemon with the mock camera, over real HTTP and real signals.
namespace overfly::test {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kFrames = 9;  // of the smoke flight

class Daemon : public ::testing::Test {
 protected:
  void SetUp() override {
    if (smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not beside the repository";
  }
  // Every tile reads back whole, every frame is in the map.
  static void expectWhole(const fs::path& mission, std::uint64_t frames = kFrames) {
    const auto reader = tiling::MapReader::open(mission / "map.overfly");
    ASSERT_TRUE(reader) << reader.error().message;
    EXPECT_TRUE(reader->verify().value().empty());
    const auto statistics = reader->statistics().value();
    EXPECT_EQ(statistics.frames[static_cast<std::size_t>(tiling::FrameState::Mapped)], frames);
    EXPECT_GT(statistics.tiles, 0u);
  }
};

// The view drawn on board: pictures differ with the direction, a stream brings one after the other, what
// cannot be drawn is refused with a reason.
void expectPreviews(const DaemonProcess& daemon) {
  const auto get = [&](const std::string& query) {
    Answer answer;
    for (int i = 0; i < 100; ++i) {  // 503: another picture a moment ago
      answer = fetch(daemon.url() + "/preview" + query, {}, "GET", {}, 60000, 30'000);
      if (answer.status != 503) break;
      std::this_thread::sleep_for(150ms);
    }
    return answer;
  };
  const auto layers = nlohmann::json::parse(fetch(daemon.url() + "/tiles.json").body)["layers"];
  ASSERT_EQ(layers[1]["encoding"], "terrarium");
  const double lon = layers[1]["center"][0], lat = layers[1]["center"][1];
  const double top = layers[1]["height_range"][1];
  const auto at = fmt::format("?lat={:.8f}&lon={:.8f}&height={:.1f}&w=96&h=64", lat, lon, top + 40);
  const auto down = get(".jpg" + at + "&pitch=-90");
  ASSERT_EQ(down.status, 200) << down.body;
  EXPECT_EQ(down.headers.at("content-type"), "image/jpeg");
  EXPECT_THAT(down.body, ::testing::StartsWith("\xFF\xD8"));
  const auto sky = get(".jpg" + at + "&pitch=60");
  ASSERT_EQ(sky.status, 200) << sky.body;
  EXPECT_LT(sky.body.size(), down.body.size());  // nothing to see beside the ground's texture
  const auto stream = get("/stream" + at + "&pitch=-60");
  EXPECT_THAT(stream.headers.at("content-type"), HasSubstr("multipart/x-mixed-replace"));
  std::size_t pictures = 0;
  for (std::size_t found = 0;
       (found = stream.body.find("Content-Type: image/jpeg", found)) != std::string::npos; ++found)
    ++pictures;
  EXPECT_GT(pictures, 1u);
  for (const char* wrong :
       {"?lat=1&lon=2", "?lat=1&lon=2&height=x", "?lat=91&lon=2&height=3", "?lat=1&lon=2&height=3&w=100000",
        "?lat=1&lon=2&height=3&fov=0", "?lat=1&lon=2&height=3&photos=9", "?lat=1&lon=2&height=3&photos=-1",
        "?lat=1&lon=2&height=3&photos=1.5", "?lat=1&lon=2&height=3&photos=all"}) {
    const auto refused = fetch(daemon.url() + "/preview.jpg" + wrong);
    EXPECT_EQ(refused.status, 400) << wrong;
    EXPECT_THAT(refused.body, HasSubstr("/preview.jpg?lat="));
  }
}

// Photographs on steep sides: the picture drawn on board is the command's with as many of them, not the one
// without.
void expectPhotographs(const DaemonProcess& daemon, const fs::path& map) {
  const auto layers = nlohmann::json::parse(fetch(daemon.url() + "/tiles.json").body)["layers"];
  const double lon = layers[1]["center"][0], lat = layers[1]["center"][1];
  const double top = layers[1]["height_range"][1];
  const auto pixels = [](const std::string& jpeg) {
    capture::Image image;
    image.bytes = {jpeg.begin(), jpeg.end()};
    image.width = 320;
    image.height = 240;
    return capture::decodeImageWords(image).value().rgbx;
  };
  const auto onBoard = [&](int photos) {
    const auto url =
        fmt::format("{}/preview.jpg?lat={:.8f}&lon={:.8f}&height={:.2f}&pitch=-55&w=320&h=240&photos={}",
                    daemon.url(), lat, lon, top + 10, photos);
    Answer answer;
    for (int i = 0; i < 100; ++i) {  // 503: another picture a moment ago
      answer = fetch(url, {}, "GET", {}, 60000);
      if (answer.status != 503) break;
      std::this_thread::sleep_for(150ms);
    }
    EXPECT_EQ(answer.status, 200) << answer.body;
    return pixels(answer.body);
  };
  const auto byCommand = [&](int photos) {
    const fs::path file = daemon.folder() / "picture.jpg";
    const auto drawn = shell(fmt::format(
        "'{}' preview '{}' --from {:.8f},{:.8f},{:.2f} --look 0,-55 --size 320x240 --photos {} -o '{}'",
        OVERFLY, map.string(), lat, lon, top + 10, photos, file.string()));
    EXPECT_EQ(drawn.status, 0) << drawn.output;
    std::ifstream in(file, std::ios::binary);
    return pixels({std::istreambuf_iterator<char>(in), {}});
  };
  const auto plain = byCommand(0), with = byCommand(4), board_plain = onBoard(0), board_with = onBoard(4),
             board_after = onBoard(0);
  std::size_t coloured = 0;
  double of_plain = 0, of_with = 0, with_of_plain = 0, after = 0;
  for (std::size_t i = 0; i < plain.size(); ++i) {
    if (i % 4 == 3 || std::abs(plain[i] - with[i]) < 40) continue;
    ++coloured;
    of_plain += std::abs(board_plain[i] - plain[i]);
    of_with += std::abs(board_with[i] - with[i]);
    with_of_plain += std::abs(board_with[i] - plain[i]);
    after += std::abs(board_after[i] - plain[i]);
  }
  std::printf("photographs change %.3f of the picture\n",
              static_cast<double>(coloured) / (0.75 * static_cast<double>(plain.size())));
  ASSERT_GT(coloured, plain.size() / 100);
  EXPECT_LT(of_with, 0.3 * with_of_plain);
  EXPECT_LT(of_plain, 0.3 * with_of_plain);
  EXPECT_LT(after, 0.3 * with_of_plain);
}

TEST_F(Daemon, MapsAFlightAndServesItsTiles) {
  DaemonProcess daemon;
  daemon.start({"--set", "map.datum=ellipsoid"});
  ASSERT_TRUE(daemon.waitUntilMapped(240s)) << daemon.log();
  const auto status = daemon.status();
  EXPECT_EQ(status["frames"]["mapped"], kFrames);
  EXPECT_GT(status["survey"]["area_m2"], 1000);
  EXPECT_EQ(status["latency"]["swept"]["frames"], kFrames);
  EXPECT_GT(status["latency"]["provisional"]["frames"], 0);
  ASSERT_EQ(daemon.missionNames().size(), 1u);
  const fs::path mission = daemon.missions() / daemon.missionNames()[0];
  expectWhole(mission);
  // No tile is left as the first sight's plain projection.
  const auto reader = tiling::MapReader::open(mission / "map.overfly");
  const auto meta = reader->meta().value();
  EXPECT_EQ(meta.datum, capture::VerticalDatum::Ellipsoid);  // the flight leaves it open
  const auto keys = reader->keys(meta.base_zoom, tiling::Layer::Elevation, {}, SIZE_MAX).value();
  ASSERT_FALSE(keys.empty());
  // What one frame alone sees, at the rim, stays a projection within its tile.
  for (const auto& key : keys) {
    const auto made = tiling::readTile(*reader, key);
    ASSERT_TRUE(made) << made.error().message;
    EXPECT_TRUE(std::ranges::any_of(
        made->kind, [](std::uint8_t kind) { return (kind & (tiling::kMeasured | tiling::kFilled)) != 0; }))
        << key.x << ", " << key.y;
  }
  const auto tile =
      fetch(fmt::format("{}/tiles/elevation/{}/{}/{}.png", daemon.url(), keys[0].zoom, keys[0].x, keys[0].y));
  EXPECT_EQ(tile.status, 200);
  EXPECT_THAT(tile.body, ::testing::StartsWith("\x89PNG"));
  expectPreviews(daemon);
  expectPhotographs(daemon, mission / "map.overfly");
  daemon.send(SIGTERM);
  EXPECT_EQ(daemon.wait(60s), 0);
}

// A disk of its own for the missions, in memory; gone with this value.
class SmallDisk {
 public:
  SmallDisk(fs::path folder, int megabytes) : folder_(std::move(folder)) {
    fs::create_directories(folder_);
    mounted_ =
        mount("overfly-test", folder_.c_str(), "tmpfs", 0, fmt::format("size={}m", megabytes).c_str()) == 0;
  }
  ~SmallDisk() {
    if (mounted_) umount2(folder_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  [[nodiscard]] bool mounted() const { return mounted_; }
  // Until it takes no byte more.
  void fill() const {
    std::ofstream ballast(folder_ / "ballast", std::ios::binary);
    const std::string page(4096, 'x');
    while (ballast.write(page.data(), static_cast<std::streamsize>(page.size())).flush()) continue;
  }
  void makeRoom() const { fs::remove(folder_ / "ballast"); }

 private:
  fs::path folder_;
  bool mounted_ = false;
};

// The kernel's own ENOSPC in the middle of the mapping: the daemon says so, serves what it has, and goes on
// by itself when there is room again.
TEST_F(Daemon, AFullDiskDegradesItAndItGoesOnWhenThereIsRoom) {
  DaemonProcess daemon;
  const SmallDisk disk(daemon.missions(), 64);
  if (!disk.mounted()) GTEST_SKIP() << "mounting a small disk takes root";
  daemon.start();
  ASSERT_TRUE(daemon.waitFor(
      [](const auto& s) { return s["frames"]["mapped"] == kFrames && s["cells"]["swept"] > 0; }, 120s))
      << daemon.log();
  disk.fill();
  ASSERT_TRUE(daemon.waitFor([](const auto& s) { return s["state"] == "degraded"; }, 120s)) << daemon.log();
  const std::string problem = daemon.status()["problem"];
  std::printf("said: %s\n", problem.c_str());
  EXPECT_THAT(problem, HasSubstr("full"));
  EXPECT_EQ(fetch(daemon.url() + "/tiles.json").status, 200);
  const fs::path mission = daemon.missions() / daemon.missionNames()[0];
  {
    const auto reader = tiling::MapReader::open(mission / "map.overfly");
    ASSERT_TRUE(reader) << reader.error().message;
    const int zoom = reader->meta().value().base_zoom;
    const auto keys = reader->keys(zoom, tiling::Layer::Color, {}, 1).value();
    ASSERT_FALSE(keys.empty());
    EXPECT_EQ(
        fetch(fmt::format("{}/tiles/color/{}/{}/{}.jpg", daemon.url(), zoom, keys[0].x, keys[0].y)).status,
        200);
  }
  disk.makeRoom();
  const auto start = Clock::now();
  ASSERT_TRUE(daemon.waitFor([](const auto& s) { return s["state"] != "degraded"; }, 30s)) << daemon.log();
  std::printf("went on %.1f s after there was room\n",
              std::chrono::duration<double>(Clock::now() - start).count());
  ASSERT_TRUE(daemon.waitUntilMapped(240s)) << daemon.log();
  daemon.send(SIGTERM);
  EXPECT_EQ(daemon.wait(60s), 0);
  expectWhole(mission);
}

// The time that it takes is measured by tests/bench; here, that nothing is torn and nothing waits for ever.
TEST_F(Daemon, EndsOnSigtermInTheMiddleOfTheWorkAndGoesOnWhereItWas) {
  DaemonProcess daemon;
  daemon.start();
  ASSERT_TRUE(daemon.waitFor([](const auto& s) { return s["cells"]["swept"] > 0; }, 120s)) << daemon.log();
  const auto start = Clock::now();
  daemon.send(SIGTERM);
  ASSERT_EQ(daemon.wait(60s), 0);
  std::printf("ended %.2f s after SIGTERM\n", std::chrono::duration<double>(Clock::now() - start).count());
  const fs::path mission = daemon.missions() / daemon.missionNames()[0];
  {
    const auto reader = tiling::MapReader::open(mission / "map.overfly");
    ASSERT_TRUE(reader) << reader.error().message;
    EXPECT_TRUE(reader->verify().value().empty());
  }
  EXPECT_FALSE(fs::exists(mission / "ended"));
  daemon.start({"--exit-when-done"});
  ASSERT_EQ(daemon.wait(240s), 0) << daemon.log();
  EXPECT_EQ(daemon.missionNames().size(), 1u);
  EXPECT_TRUE(fs::exists(mission / "ended"));
  expectWhole(mission);
}

TEST_F(Daemon, KilledAtRandomMomentsItLosesNoFrame) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(fmt::format("seed {}", seed));
  std::mt19937 random(seed);
  DaemonProcess daemon(8);
  std::size_t recorded = 0;
  fs::path mission;
  for (int kill = 0; kill < 4; ++kill) {
    daemon.start();
    std::this_thread::sleep_for(std::chrono::milliseconds(200 + random() % 4000));
    daemon.send(SIGKILL);
    ASSERT_EQ(daemon.wait(10s), 128 + SIGKILL);
    if (!fs::exists(daemon.missions()) || daemon.missionNames().empty()) continue;
    ASSERT_EQ(daemon.missionNames().size(), 1u);
    mission = daemon.missions() / daemon.missionNames()[0];
    std::size_t now = 0;
    for (int part = 1; fs::exists(mission / fmt::format("flight-{}", part)); ++part)
      if (const auto flight = capture::Flight::open(mission / fmt::format("flight-{}", part)))
        now += flight->size();
    EXPECT_GE(now, recorded);  // what was recorded stays
    recorded = now;
  }
  daemon.start({"--exit-when-done", "--set", "source.speed=0"});
  ASSERT_EQ(daemon.wait(300s), 0) << daemon.log();
  mission = daemon.missions() / daemon.missionNames()[0];
  expectWhole(mission);
}

TEST_F(Daemon, ReadsWhatMayChangeAgainOnSighup) {
  DaemonProcess daemon(1);
  daemon.start();
  ASSERT_TRUE(daemon.waitFor([](const auto& s) { return s["link"]["max_kbps"] == 0; }, 60s)) << daemon.log();
  {
    std::ifstream in(daemon.settingsFile());
    std::string text{std::istreambuf_iterator<char>(in), {}};
    text.replace(text.find("port = 0"), 8, "port = 0\nmax_kbps = 4321");
    text.replace(text.find("speed = 1"), 9, "speed = 2");
    std::ofstream(daemon.settingsFile()) << text << "[log]\nlevel = \"warning\"\n";
  }
  daemon.send(SIGHUP);
  EXPECT_TRUE(daemon.waitFor([](const auto& s) { return s["link"]["max_kbps"] == 4321; }, 60s))
      << daemon.log();
  EXPECT_THAT(daemon.log(), HasSubstr("source.speed"));  // counts from the next start, and that is said
  std::ofstream(daemon.settingsFile(), std::ios::app) << "[log]\nlevle = \"error\"\n";
  daemon.send(SIGHUP);
  for (int i = 0; i < 600 && daemon.log().find("stay as they are") == std::string::npos; ++i)
    std::this_thread::sleep_for(100ms);
  EXPECT_THAT(daemon.log(), HasSubstr("stay as they are"));
  EXPECT_EQ(daemon.status()["link"]["max_kbps"], 4321);
}

TEST_F(Daemon, MissionsAreStartedListedAndStoppedByCommandAndLink) {
  DaemonProcess daemon(1, "[mission]\nstart = \"command\"\n");
  daemon.start();
  const auto overfly = [&](const std::string& arguments) {
    return shell(fmt::format("{} {} --url {}", OVERFLY, arguments, daemon.url()));
  };
  EXPECT_THAT(overfly("mission list").output, HasSubstr("no mission yet"));
  EXPECT_EQ(overfly("mission stop").status, 1);
  const Outcome first = overfly("mission start first");
  EXPECT_EQ(first.status, 0) << first.output;
  EXPECT_EQ(overfly("mission start second").status, 1);  // one at a time
  ASSERT_TRUE(daemon.waitFor([](const auto& s) { return s["frames"]["seen"] > 0; }, 60s)) << daemon.log();
  EXPECT_EQ(overfly("mission stop").status, 0);
  EXPECT_EQ(overfly("mission start ../elsewhere").status, 1);
  const auto started = fetch(daemon.url() + "/missions", {}, "POST", R"({"name": "second"})");
  EXPECT_EQ(started.status, 201) << started.body;
  ASSERT_TRUE(daemon.waitFor(
      [](const auto& s) { return s["mission"]["name"] == "second" && s["frames"]["seen"] > 0; }, 60s));
  const auto list = nlohmann::json::parse(overfly("mission list --json").output)["missions"];
  ASSERT_EQ(list.size(), 2u);
  EXPECT_EQ(list[0]["id"], "first");
  EXPECT_EQ(list[0]["live"], false);
  EXPECT_EQ(list[1]["id"], "second");
  EXPECT_EQ(list[1]["live"], true);
  EXPECT_EQ(list[1]["current"], true);
  EXPECT_EQ(fetch(daemon.url() + "/missions", {}, "DELETE").status, 204);
  for (const char* name : {"first", "second"})
    EXPECT_TRUE(fs::exists(daemon.missions() / name / "flight-1" / "flight.json")) << name;
}

// systemd's end of sd_notify.
class NotifySocket {
 public:
  explicit NotifySocket(const fs::path& path) : fd_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.string().copy(address.sun_path, sizeof address.sun_path - 1);
    const timeval wait{0, 200000};
    setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof wait);
    EXPECT_EQ(bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~NotifySocket() { close(fd_); }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;
  // The next message, or nothing within 0.2 s.
  std::string next() {
    char text[4096];
    const ssize_t bytes = recv(fd_, text, sizeof text, 0);
    return bytes > 0 ? std::string(text, static_cast<std::size_t>(bytes)) : std::string();
  }

 private:
  int fd_;
};

TEST_F(Daemon, TheWatchdogIsFedByProgressAndByIdlenessButNotBesideAStuckStage) {
  for (const bool stuck : {false, true}) {
    DaemonProcess daemon;
    NotifySocket socket(daemon.folder() / "notify");
    daemon.start(
        stuck ? std::vector<std::string>{"--inject-fault", "mapping:stuck@5"} : std::vector<std::string>{},
        {"NOTIFY_SOCKET=" + (daemon.folder() / "notify").string()});
    bool ready = false, told = false;
    std::string statuses;
    auto fed = Clock::now();
    const auto until = Clock::now() + (stuck ? 120s : 25s);
    while (Clock::now() < until && !told) {
      const std::string message = socket.next();
      ready = ready || message.find("READY=1") != std::string::npos;
      if (message.find("WATCHDOG=1") != std::string::npos) fed = Clock::now();
      if (message.starts_with("STATUS=")) statuses = message;
      told = message.find("stuck: mapping") != std::string::npos;
    }
    EXPECT_TRUE(ready);
    EXPECT_EQ(told, stuck) << statuses;
    EXPECT_THAT(statuses, HasSubstr("frames"));
    if (!stuck) {
      EXPECT_LT(Clock::now() - fed, 15s);  // also long after the last frame
      continue;
    }
    EXPECT_EQ(fetch(daemon.url() + "/healthz").status, 503);
    for (int i = 0; i < 15; ++i) EXPECT_THAT(socket.next(), Not(HasSubstr("WATCHDOG=1")));
    // What systemd then does; nothing is lost by it.
    daemon.send(SIGKILL);
    (void)daemon.wait(10s);
    daemon.start({"--exit-when-done"});
    ASSERT_EQ(daemon.wait(240s), 0) << daemon.log();
    expectWhole(daemon.missions() / daemon.missionNames()[0]);
  }
}

TEST_F(Daemon, WrongSettingsEndItForGood) {
  DaemonProcess daemon(0, "[sweep]\nimagess = 3\n");
  daemon.start();
  EXPECT_EQ(daemon.wait(60s), 2);
  EXPECT_THAT(daemon.log(), HasSubstr("did you mean sweep.images"));
}

TEST_F(Daemon, AGpuThatIsNotThereEndsItWithTheListOfThoseThatAre) {
  DaemonProcess daemon(0, "[gpu]\ndevice = \"/dev/dri/renderD200\"\n");
  daemon.start();
  EXPECT_EQ(daemon.wait(60s), 2);
  EXPECT_THAT(daemon.log(), HasSubstr("gpu.device: there is no \"/dev/dri/renderD200\" here; found 0: "));
  daemon.start({"--set", "gpu.device=0", "--exit-when-done"});
  EXPECT_EQ(daemon.wait(240s), 0) << daemon.log();
}

}  // namespace
}  // namespace overfly::test
