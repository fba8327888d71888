#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <thread>

#include "tests/integration/daemon/daemon_process.h"
#include "tests/integration/link/client.h"
#include "tests/integration/link/made_map.h"
#include "tests/integration/page/browser.h"
#include "tiling/pyramid/map_writer.h"
#include "tiling/pyramid/pyramid.h"
#include "tiling/store/tile_codec.h"

namespace overfly::test {
namespace {

using namespace std::chrono_literals;

bool becomes(const std::function<bool()>& what, std::chrono::seconds patience) {
  const auto until = std::chrono::steady_clock::now() + patience;
  while (!what()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(300ms);
  }
  return true;
}

// A browser before the page. OVERFLY_SCREENSHOTS=FOLDER keeps what was seen, for a person.
class Seen : public testing::Test {
 protected:
  // Empty: the page of `url` is there.
  std::string open(const std::string& url, bool webgl) {
    std::string problem;
    browser_ = Browser::start(1280, 800, problem, webgl);
    if (browser_) browser_->open(url);
    return problem;
  }
  // All tiles that are in view are there.
  bool still() { return browser_->run("return Boolean(window.overfly && overfly.view.atRest)") == true; }
  void keep(const std::string& name) {
    if (const char* folder = std::getenv("OVERFLY_SCREENSHOTS"))
      std::ofstream(std::filesystem::path(folder) / (name + ".png"), std::ios::binary)
          << browser_->screenshotPng();
  }
  // A browser prefers dark or light as its desktop does.
  void beDark() {
    if (browser_->run("return document.documentElement.dataset.theme") != "dark") click("#theme");
  }
  void click(const std::string& selector) {
    browser_->run("document.querySelector('" + selector + "').click()");
  }
  std::string text(const std::string& selector) {
    return browser_->run("return document.querySelector('" + selector + "').textContent").get<std::string>();
  }

  // Pixels of the middle of the map, where no panel lies, that differ by more than a little.
  static std::size_t differing(const Picture& a, const Picture& b) {
    std::size_t out = 0;
    if (a.width != b.width || a.height != b.height) return SIZE_MAX;
    for (int y = a.height / 4; y < a.height * 3 / 4; ++y)
      for (int x = a.width * 2 / 5; x < a.width * 4 / 5; ++x)
        for (int c = 0; c < 3; ++c) {
          const auto at = (static_cast<std::size_t>(y) * static_cast<std::size_t>(a.width) +
                           static_cast<std::size_t>(x)) *
                              3 +
                          static_cast<std::size_t>(c);
          if (std::abs(int{a.rgb[at]} - int{b.rgb[at]}) > 24) {
            ++out;
            break;
          }
        }
    return out;
  }
  Picture settled() {
    auto last = browser_->screenshot();
    EXPECT_TRUE(becomes(
        [&] {
          auto next = browser_->screenshot();
          const bool same = still() && differing(last, next) == 0;
          last = std::move(next);
          return same;
        },
        60s));
    return last;
  }
  // What a click changes on the map, in pixels.
  void expectToChange(Picture& shown, const std::string& name, const std::string& selector) {
    SCOPED_TRACE(name);
    click(selector);
    std::this_thread::sleep_for(300ms);
    auto now = settled();
    keep(name);
    EXPECT_GT(differing(shown, now), 2000u);
    shown = std::move(now);
  }
  // Thumbs: nothing that is to be tapped is smaller than 44 px, or off the screen.
  void expectFitForThumbs() {
    const auto small = browser_->run(
        "return [...document.querySelectorAll('button, input:not([type=file])')].filter(b => { const r = "
        "b.getBoundingClientRect(); return r.width > 0 && (r.width < 44 || r.height < 44); }).map(b => b.id "
        "|| "
        "b.textContent)");
    EXPECT_TRUE(small.empty()) << small.dump();
    const auto outside = browser_->run(
        "return [...document.querySelectorAll('button,.meter,.panel')].filter(b => { const r = "
        "b.getBoundingClientRect(); return r.width > 0 && (r.left < 0 || r.right > innerWidth || r.top < 0 "
        "|| "
        "r.bottom > innerHeight); }).map(b => b.id || b.textContent)");
    EXPECT_TRUE(outside.empty()) << outside.dump();
  }

  std::unique_ptr<Browser> browser_;
};

// Over `overfly serve` and a map that the test goes on making.
class Page : public Seen {
 protected:
  void SetUp() override { show(true); }
  void show(bool webgl) {
    std::string pattern = std::filesystem::temp_directory_path() / "overfly-page-XXXXXX";
    folder_ = mkdtemp(pattern.data());
    map_ = std::make_unique<MadeMap>(folder_ / "made.overfly", geo::TileKey{18, 137000, 87000}, 4);
    for (int x = 0; x < 4; ++x) map_->make({{x, 0}, {x, 1}});
    map_->addFrames(14);
    server_ = std::make_unique<Program>(
        std::vector<std::string>{OVERFLY_PROGRAM, "serve", map_->path(), "--listen", "127.0.0.1:0"});
    url_ = server_->line(30s);
    ASSERT_TRUE(url_.starts_with("http://")) << url_;
    if (webgl && fetch(url_ + "maplibre-gl.js").status != 200)
      GTEST_SKIP() << "built without npm: the page has its flat map alone";
    if (const auto problem = open(url_, webgl); !problem.empty()) GTEST_SKIP() << problem;
    ASSERT_TRUE(becomes([&] { return still(); }, 120s)) << "the map never came to rest";
    ASSERT_EQ(browser_->run("return overfly.view.tilts"), webgl);
  }
  void TearDown() override {
    browser_.reset();
    server_.reset();
    map_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  void expectOnlyOwnRequests() {
    const auto requests = browser_->requests();
    EXPECT_GT(requests.size(), 20u);
    for (const auto& request : requests)
      EXPECT_TRUE(request.starts_with(url_) ||
                  request.starts_with("blob:" + url_.substr(0, url_.size() - 1)) ||
                  request.starts_with("data:"))
          << request;
  }
  void expectNewTilesToBeShown(const std::string& name) {
    const auto before = settled();
    keep(name + "-1");
    for (int x = 0; x < 4; ++x) map_->make({{x, 2}, {x, 3}});
    Picture after;
    EXPECT_TRUE(becomes(
        [&] {
          after = browser_->screenshot();
          return differing(before, after) > 5000;
        },
        60s))
        << differing(before, after) << " pixels changed";
    settled();
    keep(name + "-2");
  }

  std::filesystem::path folder_;
  std::unique_ptr<MadeMap> map_;
  std::unique_ptr<Program> server_;
  std::string url_;
};

// The same in a browser without WebGL.
class FlatPage : public Page {
 protected:
  void SetUp() override { show(false); }
};

TEST_F(Page, PixelsChangeWhenTilesArriveAndNoRequestLeavesTheMachine) {
  expectNewTilesToBeShown("live");
  expectOnlyOwnRequests();
}

TEST_F(Page, ControlsShowWhatTheySay) {
  beDark();
  for (int x = 0; x < 4; ++x) map_->make({{x, 2}, {x, 3}});
  auto shown = settled();
  const auto changes = [&](const std::string& name, const std::string& selector) {
    expectToChange(shown, name, selector);
  };
  changes("coverage", "[data-layer=coverage]");
  click("[data-layer=coverage]");
  shown = settled();
  changes("quality", "[data-layer=quality]");
  click("[data-layer=quality]");
  shown = settled();
  changes("relief", "[data-ground=relief]");
  changes("shaded", "[data-ground=both]");
  changes("terrain-3d", "#tilt");
  click("#tilt");
  std::this_thread::sleep_for(1s);
  // a planned area half of which no frame has seen
  const auto c = map_->centre();
  const double lat = geo::degrees(c.lat), lon = geo::degrees(c.lon), d = 0.0015;
  const nlohmann::json ring{
      {lon - d, lat - d}, {lon + d, lat - d}, {lon + d, lat + d}, {lon - d, lat + d}, {lon - d, lat - d}};
  const nlohmann::json plan{{"type", "Polygon"}, {"coordinates", {ring}}};
  ASSERT_EQ(fetch(url_ + "plan", {}, "PUT", plan.dump()).status, 204);
  browser_->open(url_);
  EXPECT_TRUE(becomes(
      [&] {
        return browser_->run("return document.getElementById('cover').textContent")
            .get<std::string>()
            .ends_with("%");
      },
      60s));
  shown = settled();
  keep("plan");
  EXPECT_EQ(browser_->run("return document.documentElement.dataset.theme"), "dark");
  click("#theme");
  EXPECT_EQ(browser_->run("return document.documentElement.dataset.theme"), "light");
  keep("light");
  browser_->resize(820, 1180);
  std::this_thread::sleep_for(1s);
  settled();
  keep("tablet-light");
  expectFitForThumbs();
  click("#theme");
  click("#tilt");
  std::this_thread::sleep_for(1s);
  settled();
  keep("tablet-dark-3d");
}

TEST_F(Page, AFinishedMapOffersNeitherMissionsToBeginNorAnAccuracy) {
  click("#mission");
  EXPECT_TRUE(becomes(
      [&] { return browser_->run("return document.querySelectorAll('[data-mission]').length") == 1; }, 20s));
  EXPECT_EQ(browser_->run("return ['mission-new', 'mission-end', 'accuracy'].map(id => "
                          "document.getElementById(id).hidden)"),
            nlohmann::json::array({true, true, true}));
}

// The orthophoto upside down in brightness stands for the second camera's.
void addThermal(MadeMap& map) {
  auto reader = map.store().reader();
  ASSERT_TRUE(reader);
  const auto keys = reader->keys(map.corner().zoom, tiling::Layer::Color, {}, SIZE_MAX);
  ASSERT_TRUE(keys);
  tiling::MapWriter writer(map.store());
  for (const geo::TileKey& key : *keys) {
    auto tile = tiling::readTile(*reader, key, tiling::only(tiling::Layer::Color));
    ASSERT_TRUE(tile);
    for (std::size_t i = 0; i < tile->color.size(); ++i)
      if (i % 4 != 3) tile->color[i] = static_cast<std::uint8_t>(255 - tile->color[i]);
    ASSERT_TRUE(writer.addPicture(*tile, tiling::Layer::Thermal));
  }
  ASSERT_TRUE(writer.flush());
  ASSERT_TRUE(tiling::makePyramid(map.store(), tiling::Layer::Thermal));
}

TEST_F(Page, OffersASecondCamerasPicturesWhereTheMapHasThem) {
  EXPECT_EQ(browser_->run("return document.querySelector('[data-ground=thermal]').hidden"), true);
  addThermal(*map_);
  browser_->open(url_);
  ASSERT_TRUE(becomes([&] { return still(); }, 60s));
  EXPECT_EQ(browser_->run("return document.querySelector('[data-ground=thermal]').hidden"), false);
  EXPECT_EQ(browser_->run("return document.querySelector('[data-ground=near_infrared]').hidden"), true);
  auto shown = settled();
  expectToChange(shown, "thermal", "[data-ground=thermal]");
}

TEST_F(FlatPage, OffersASecondCamerasPicturesWhereTheMapHasThem) {
  addThermal(*map_);
  browser_->open(url_);
  ASSERT_TRUE(becomes([&] { return still(); }, 60s));
  auto shown = settled();
  expectToChange(shown, "flat-thermal", "[data-ground=thermal]");
}

TEST_F(FlatPage, PixelsChangeWhenTilesArriveAndNoRequestLeavesTheMachine) {
  expectNewTilesToBeShown("flat");
  expectOnlyOwnRequests();
}

TEST_F(FlatPage, IsMovedByAFingerAndShowsWhatTheControlsSay) {
  for (int x = 0; x < 4; ++x) map_->make({{x, 2}, {x, 3}});
  auto shown = settled();
  expectToChange(shown, "flat-coverage", "[data-layer=coverage]");
  click("[data-layer=coverage]");
  shown = settled();
  expectToChange(shown, "flat-quality", "[data-layer=quality]");
  click("[data-layer=quality]");
  shown = settled();
  expectToChange(shown, "flat-relief", "[data-ground=relief]");
  expectToChange(shown, "flat-shaded", "[data-ground=both]");
  expectToChange(shown, "flat-closer", "#zoom-in");
  expectToChange(shown, "flat-farther", "#zoom-out");
  EXPECT_EQ(browser_->run("return ['tilt', 'north'].map(id => document.getElementById(id).hidden)"),
            nlohmann::json::array({true, true}));
  // what lay below the finger goes with it
  const auto placeAt = [&](int x, int y) {
    click("#zoom-in");  // to a whole zoom and back, so that the height asked for is that of the place now
    click("#zoom-out");
    std::this_thread::sleep_for(1s);
    browser_->drag(x, y, x, y);
    EXPECT_TRUE(becomes([&] { return text("#place").find(',') != std::string::npos; }, 20s));
    return text("#place");
  };
  const auto before = placeAt(640, 400);
  browser_->drag(640, 400, 760, 330);
  EXPECT_EQ(placeAt(760, 330), before);
  EXPECT_NE(placeAt(640, 400), before);
  EXPECT_NE(text("#height").find(" m ± "), std::string::npos) << text("#height");
  browser_->resize(820, 1180);
  std::this_thread::sleep_for(1s);
  click("#theme");
  click("#fit");
  settled();
  keep("flat-tablet-light");
  expectFitForThumbs();
}

// Over overflyd, which maps the smoke flight while it is looked at; by the token's own path, as a tablet
// does.
class LivePage : public Seen {
 protected:
  void SetUp() override {
    if (smokeFlight().empty()) GTEST_SKIP() << "no recorded flights here";
    daemon_ = std::make_unique<DaemonProcess>(0.5, "[mission]\nstart = \"command\"\n");
    const auto file = (daemon_->folder() / "token").string();
    Program maker({OVERFLY_PROGRAM, "token", "new", "--file", file});
    const auto token = maker.line(20s);
    ASSERT_FALSE(token.empty());
    maker.wait(20s);
    const auto port = std::to_string(freePort());
    daemon_->start(
        {"--set", "link.listen=0.0.0.0", "--set", "link.port=" + port, "--set", "link.token_file=" + file});
    ASSERT_TRUE(becomes([&] { return fetch("http://127.0.0.1:" + port + "/healthz").status == 401; }, 60s))
        << daemon_->log();
    url_ = "http://127.0.0.1:" + port + "/t/" + token + "/";
    if (const auto problem = open(url_, true); !problem.empty()) GTEST_SKIP() << problem;
  }
  void TearDown() override {
    browser_.reset();
    daemon_.reset();
  }
  static int freePort() {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof at;
    if (bind(fd, reinterpret_cast<sockaddr*>(&at), sizeof at) != 0) throw std::runtime_error("no free port");
    getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size);
    close(fd);
    return ntohs(at.sin_port);
  }
  nlohmann::json answer(const std::string& path) {
    return nlohmann::json::parse(fetch(url_ + path).body, nullptr, false);
  }
  std::vector<std::string> listed() {
    return browser_
        ->run("return [...document.querySelectorAll('[data-mission]')].map(m => m.dataset.mission)")
        .get<std::vector<std::string>>();
  }
  void begin(const std::string& name) {
    browser_->run("document.getElementById('mission-called').value = '" + name + "'");
    click("#mission-new button");
  }

  std::unique_ptr<DaemonProcess> daemon_;
  std::string url_;
};

TEST_F(LivePage, MissionsAreBegunEndedAndChosenFromTheMenu) {
  EXPECT_TRUE(becomes([&] { return text("#state") == "ready for a mission"; }, 60s)) << text("#state");
  click("#mission");
  ASSERT_TRUE(becomes(
      [&] { return browser_->run("return document.getElementById('mission-new').hidden") == false; }, 30s));
  keep("missions-none");
  begin("no/good");
  EXPECT_TRUE(becomes([&] { return text("#note").find("letters") != std::string::npos; }, 20s))
      << text("#note");
  EXPECT_TRUE(answer("missions")["missions"].empty());
  begin("first");
  EXPECT_TRUE(becomes([&] { return text("#state") == "mapping live"; }, 120s)) << text("#state");
  EXPECT_EQ(text("#mission-name"), "first");
  ASSERT_TRUE(becomes([&] { return still(); }, 180s)) << "the map never came";
  keep("missions-live");
  // one tap is not enough to end it
  click("#mission-end");
  std::this_thread::sleep_for(1s);
  EXPECT_EQ(answer("missions")["missions"][0]["live"], true);
  click("#mission-end");
  EXPECT_TRUE(becomes([&] { return answer("missions")["missions"][0]["live"] == false; }, 20s));
  EXPECT_TRUE(becomes([&] { return text("#state") == "finished map"; }, 30s)) << text("#state");
  begin("second");
  EXPECT_TRUE(
      becomes([&] { return text("#mission-name") == "second" && text("#state") == "mapping live"; }, 60s))
      << text("#mission-name") << ": " << text("#state");
  EXPECT_EQ(listed(), (std::vector<std::string>{"second", "first"}));
  click("[data-mission=first]");
  EXPECT_TRUE(
      becomes([&] { return still() && browser_->run("return overfly.tiles.base") == "m/first/"; }, 120s));
  EXPECT_EQ(text("#mission-name"), "first");
  EXPECT_EQ(browser_->run("return overfly.tiles.info.mission"), "first");
  keep("missions-chosen");
  browser_->resize(820, 1180);
  expectFitForThumbs();
  click("[data-mission=second]");
  EXPECT_TRUE(becomes([&] { return browser_->run("return overfly.tiles.base") == ""; }, 60s));
  EXPECT_EQ(text("#mission-name"), "second");
}

TEST_F(LivePage, TheAccuracyPanelShowsThePointTheLagAndWhatWaits) {
  ASSERT_EQ(fetch(url_ + "missions", {}, "POST", R"({"name": "field"})").status, 201);
  ASSERT_TRUE(becomes([&] { return still(); }, 180s)) << "the map never came";
  const auto front = answer("front");
  ASSERT_TRUE(front.is_object() && front["points"].size() > 4) << front.dump();
  beDark();
  click("#accuracy");
  const auto points = front["points"].size();
  EXPECT_TRUE(becomes(
      [&] { return browser_->run("return document.querySelectorAll('.point').length") == points; }, 30s));
  EXPECT_TRUE(becomes(
      [&] {
        return text("#accuracy b") == std::to_string(answer("status")["quality"]["index"].get<int>()) +
                                          " / " + std::to_string(points);
      },
      30s))
      << text("#accuracy b");
  // the present point is marked at its place: the error that the table states, upwards
  EXPECT_EQ(browser_->run("return document.querySelectorAll('.point.now').length"), 1);
  EXPECT_TRUE(becomes(
      [&] {
        return browser_->run("return document.querySelector('.point.now').dataset.point") ==
               std::to_string(answer("status")["quality"]["index"].get<int>() - 1);
      },
      40s));
  const auto places = browser_->run(
      "return [...document.querySelectorAll('.point')].sort((a, b) => a.dataset.point - b.dataset.point)"
      ".map(p => +p.getAttribute('cy'))");
  for (std::size_t i = 1; i < points; ++i)
    EXPECT_EQ(front["points"][i]["error_gsd"]<front["points"][i - 1]["error_gsd"], places[i]> places[i - 1])
        << i;
  const auto facts = text("#accuracy-facts");
  for (const auto* what :
       {"Made at", "Expected error", "texels", "Time per tile", "Lag", "Waiting", "To be improved"})
    EXPECT_NE(facts.find(what), std::string::npos) << what << " in " << facts;
  EXPECT_TRUE(becomes([&] { return text("#accuracy-facts").find("ms here") != std::string::npos; }, 60s))
      << text("#accuracy-facts");
  keep("accuracy-dark");
  // another point is told when it is tapped
  const auto place = browser_->run(
      "const r = document.querySelector('[data-point=\"0\"]').getBoundingClientRect(); return [r.x + r.width "
      "/ 2, r.y + "
      "r.height / 2]");
  browser_->drag(place[0].get<int>(), place[1].get<int>(), place[0].get<int>(), place[1].get<int>());
  const std::string cheapest = front["points"][0]["name"];
  EXPECT_TRUE(becomes([&] { return text("#accuracy-facts").find(cheapest) != std::string::npos; }, 20s))
      << text("#accuracy-facts");
  click("#theme");
  browser_->resize(820, 1180);
  std::this_thread::sleep_for(1s);
  settled();
  keep("accuracy-tablet-light");
  expectFitForThumbs();
}

}  // namespace
}  // namespace overfly::test
