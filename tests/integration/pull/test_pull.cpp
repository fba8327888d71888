#include <fmt/format.h>
#include <sys/stat.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "daemon/link/token.h"
#include "tests/integration/link/client.h"
#include "tests/integration/link/made_map.h"
#include "tests/integration/pull/mirror_check.h"
#include "tests/integration/pull/program.h"

namespace overfly::test {
namespace {

using namespace std::chrono_literals;

// `overfly serve` on a made-up map, and `overfly pull` from it.
class Pull : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = std::filesystem::temp_directory_path() / "overfly-pull-XXXXXX";
    folder_ = mkdtemp(pattern.data());
    map_ = std::make_unique<MadeMap>(folder_ / "drone.overfly", geo::TileKey{18, 137001, 87001}, 3);
  }
  void TearDown() override {
    server_.reset();
    map_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  // Again at the same port when it ran before.
  void serve(const std::vector<std::string>& settings = {}) {
    std::vector<std::string> arguments{OVERFLY_PROGRAM, "serve", folder_ / "drone.overfly", "--listen",
                                       "127.0.0.1:" + std::to_string(port_)};
    for (const auto& one : settings) {
      arguments.emplace_back("--set");
      arguments.push_back(one);
    }
    server_ = std::make_unique<Program>(arguments, folder_ / "serve.err");
    url_ = server_->line(20s);
    const auto colon = url_.rfind(':');
    ASSERT_TRUE(url_.starts_with("http") && colon != std::string::npos) << url_;
    port_ = std::stoi(url_.substr(colon + 1));
  }
  std::unique_ptr<Program> pull(std::vector<std::string> extra, const std::string& target = "mirror") {
    std::vector<std::string> arguments{OVERFLY_PROGRAM, "pull", url_, folder_ / target, "--json"};
    arguments.insert(arguments.end(), extra.begin(), extra.end());
    return std::make_unique<Program>(arguments, folder_ / "pull.err");
  }
  // The last thing that a run with --json said.
  static nlohmann::json last(Program& program) {
    std::string line, next;
    while (!(next = program.line(200ms)).empty()) line = next;
    return line.empty() ? nlohmann::json() : nlohmann::json::parse(line);
  }
  [[nodiscard]] std::string errors() const {
    std::ifstream in(folder_ / "pull.err");
    return {std::istreambuf_iterator<char>(in), {}};
  }
  [[nodiscard]] std::filesystem::path mirror() const { return folder_ / "mirror" / "drone.overfly"; }
  [[nodiscard]] std::filesystem::path drone() const { return folder_ / "drone.overfly"; }

  std::filesystem::path folder_;
  std::unique_ptr<MadeMap> map_;
  std::unique_ptr<Program> server_;
  std::string url_;
  int port_ = 0;
};

TEST_F(Pull, OnceEndsWithExactlyTheDronesTiles) {
  map_->makeAll();
  map_->erase(1, 1);
  serve();
  for (int run = 0; run < 2; ++run) {
    auto program = pull({"--once"});
    ASSERT_EQ(program->wait(60s), 0) << errors();
    const auto status = last(*program);
    EXPECT_TRUE(status["complete"]);
    // The second run finds everything there and fetches nothing.
    EXPECT_EQ(status["layers"], run == 0 ? sizeOf(*tiling::MapReader::open(drone())).layers : 0) << run;
    expectSame(drone(), mirror());
  }
  map_->make({{0, 2}}, 1);
  map_->erase(2, 2);
  ASSERT_EQ(pull({"--once"})->wait(60s), 0) << errors();
  expectSame(drone(), mirror());
}

TEST_F(Pull, FollowsALiveMapAndServesItsMirror) {
  map_->make({{0, 0}});
  serve();
  auto program = pull({"--serve", "127.0.0.1:0"});
  // with --json the mirror's address goes to stderr, so that stdout is JSON alone
  std::string address;
  for (int i = 0; i < 200 && address.empty(); ++i) {
    std::this_thread::sleep_for(50ms);
    std::istringstream in(errors());
    for (std::string line; std::getline(in, line);)
      if (line.starts_with("http://")) address = line;
  }
  ASSERT_FALSE(address.empty()) << errors();
  // A client of the mirror hears of the growth, too.
  for (int i = 0; i < 200 && fetch(address + "tiles.json").status != 200; ++i)
    std::this_thread::sleep_for(50ms);
  std::thread growth([this] {
    for (int i = 0; i < 9; ++i) {
      map_->make({{i % 3, i / 3}});
      std::this_thread::sleep_for(150ms);
    }
  });
  const auto events = fetch(address + "events", {}, "GET", {}, 4000).body;
  growth.join();
  EXPECT_NE(events.find("event: change"), std::string::npos) << events;
  nlohmann::json status;
  for (int i = 0; i < 200; ++i) {
    status = nlohmann::json::parse(fetch(address + "status").body);
    if (status["state"] == "idle" && status["pull"]["revision"] == *map_->store().reader()->revision()) break;
    std::this_thread::sleep_for(100ms);
  }
  EXPECT_EQ(status["state"], "idle") << status.dump(1);
  expectSame(drone(), mirror());
  const auto tile = fmt::format("tiles/color/18/{}/{}.webp", map_->corner().x + 1, map_->corner().y + 1);
  EXPECT_EQ(fetch(address + tile).body, fetch(url_ + tile).body);
  program->end(SIGTERM);
  EXPECT_EQ(program->wait(1s), 0);
}

TEST_F(Pull, SurvivesItsOwnDeathsAndTheDronesWhileTheMapGrows) {
  map_->makeAll();
  serve({"link.max_kbps=4000"});
  std::thread growth([this] {
    for (int i = 0; i < 12; ++i) {
      map_->make({{i % 3, i % 2}}, i % 3);
      std::this_thread::sleep_for(200ms);
    }
  });
  for (int i = 0; i < 6; ++i) {
    auto program = pull({});
    std::this_thread::sleep_for(std::chrono::milliseconds(250 + 70 * i));
    if (i % 2 == 0) {
      server_->end(SIGKILL);
      std::this_thread::sleep_for(100ms);
      serve({"link.max_kbps=4000"});
      std::this_thread::sleep_for(300ms);
    }
    program->end(SIGKILL);
    if (const auto reader = tiling::MapReader::open(mirror())) {
      EXPECT_TRUE(reader->verify()->empty()) << "torn after kill " << i;
    }
  }
  growth.join();
  auto program = pull({"--once"});
  ASSERT_EQ(program->wait(120s), 0) << errors();
  expectSame(drone(), mirror());
}

TEST_F(Pull, MbTilesHoldTheColourOfTheDrone) {
  map_->makeAll();
  serve();
  ASSERT_EQ(pull({"--once"}, "map.mbtiles")->wait(60s), 0) << errors();
  map_->make({{1, 1}}, 1);
  ASSERT_EQ(pull({"--once"}, "map.mbtiles")->wait(60s), 0) << errors();
  // GDAL reads it and says the right place
  const auto west = (137001.0 / (1 << 18) - 0.5) * 2 * 20037508.342789244;
  Program gdal({"/usr/bin/gdalinfo", "-json", folder_ / "map.mbtiles"});
  std::string text;
  for (std::string line; !(line = gdal.line(20s)).empty();) text += line + "\n";
  const auto info = nlohmann::json::parse(text, nullptr, false);
  ASSERT_TRUE(info.is_object()) << text;
  EXPECT_NEAR(info["cornerCoordinates"]["upperLeft"][0].get<double>(), west, 1);
}

TEST_F(Pull, TlsIsTrustedOnlyWithTheDronesOwnCertificate) {
  map_->make({{0, 0}});
  const auto certificate = (folder_ / "cert.pem").string(), key = (folder_ / "key.pem").string();
  Program openssl({"/usr/bin/openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt",
                   "ec_paramgen_curve:prime256v1", "-nodes", "-subj", "/CN=drone", "-addext",
                   "subjectAltName=IP:127.0.0.1", "-days", "2", "-keyout", key, "-out", certificate});
  if (openssl.wait(60s) != 0) GTEST_SKIP() << "openssl is not installed";
  serve({"link.tls_certificate=" + certificate, "link.tls_key=" + key});
  ASSERT_TRUE(url_.starts_with("https://")) << url_;
  EXPECT_EQ(pull({"--once", "--give-up", "1"})->wait(60s), 1);
  EXPECT_NE(errors().find("certificate"), std::string::npos) << errors();
  ASSERT_EQ(pull({"--once", "--ca", certificate})->wait(60s), 0) << errors();
  expectSame(drone(), mirror());
}

TEST_F(Pull, SaysWhatToDoWhenItCannot) {
  map_->makeAll();
  const auto token = link::makeToken();
  ASSERT_TRUE(link::writeToken(folder_ / "token", token));
  serve();
  const auto told = [&](std::vector<std::string> extra, const std::string& target, int status,
                        const char* what) {
    std::filesystem::remove(folder_ / "pull.err");
    EXPECT_EQ(pull(extra, target)->wait(30s), status) << what;
    EXPECT_NE(errors().find(what), std::string::npos) << errors();
  };
  std::filesystem::copy_file(drone(), folder_ / "copy.overfly");
  std::filesystem::create_directory(folder_ / "taken");
  std::filesystem::rename(folder_ / "copy.overfly", folder_ / "taken" / "drone.overfly");
  told({"--once"}, "taken", 1, "is no mirror");
  told({"--serve", "127.0.0.1:0"}, "m.mbtiles", 2, "--serve needs a folder");
  told({"--token-file", folder_ / "none"}, "mirror", 2, "cannot read a token");
  const auto url = url_;
  url_ = url + "nothing/";
  told({"--once"}, "mirror", 2, "no map of overfly at that URL");
  url_ = url;
  server_.reset();
  told({"--once", "--give-up", "1"}, "mirror", 1, "has not answered for 1 s");
}

}  // namespace
}  // namespace overfly::test
