#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <thread>

#include "tests/integration/link/client.h"
#include "tests/integration/link/made_map.h"
#include "tests/integration/page/browser.h"

namespace overfly::test {
namespace {

using namespace std::chrono_literals;

// OVERFLY_SCREENSHOTS=FOLDER keeps what was seen, for a person.
class Page : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = std::filesystem::temp_directory_path() / "overfly-page-XXXXXX";
    folder_ = mkdtemp(pattern.data());
    map_ = std::make_unique<MadeMap>(folder_ / "made.overfly", geo::TileKey{18, 137000, 87000}, 4);
    for (int x = 0; x < 4; ++x) map_->make({{x, 0}, {x, 1}});
    map_->addFrames(14);
    server_ = std::make_unique<Program>(
        std::vector<std::string>{OVERFLY_PROGRAM, "serve", map_->path(), "--listen", "127.0.0.1:0"});
    url_ = server_->line(30s);
    ASSERT_TRUE(url_.starts_with("http://")) << url_;
    if (fetch(url_ + "maplibre-gl.js").status != 200)
      GTEST_SKIP() << "built without npm: the page is the plain one";
    std::string problem;
    browser_ = Browser::start(1280, 800, problem);
    if (!browser_) GTEST_SKIP() << problem;
    browser_->open(url_);
    ASSERT_TRUE(becomes([&] { return still(); }, 120s)) << "the map never came to rest";
  }
  void TearDown() override {
    browser_.reset();
    server_.reset();
    map_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  static bool becomes(const std::function<bool()>& what, std::chrono::seconds patience) {
    const auto until = std::chrono::steady_clock::now() + patience;
    while (!what()) {
      if (std::chrono::steady_clock::now() > until) return false;
      std::this_thread::sleep_for(300ms);
    }
    return true;
  }
  // All tiles of all sources are there.
  bool still() {
    return browser_->run(
               "return Boolean(window.overfly && overfly.map.getSource('color') && overfly.map.loaded() && "
               "overfly.map.areTilesLoaded())") == true;
  }
  void keep(const std::string& name) {
    if (const char* folder = std::getenv("OVERFLY_SCREENSHOTS"))
      std::ofstream(std::filesystem::path(folder) / (name + ".png"), std::ios::binary)
          << browser_->screenshotPng();
  }
  void click(const std::string& selector) {
    browser_->run("document.querySelector('" + selector + "').click()");
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

  std::filesystem::path folder_;
  std::unique_ptr<MadeMap> map_;
  std::unique_ptr<Program> server_;
  std::unique_ptr<Browser> browser_;
  std::string url_;
};

TEST_F(Page, PixelsChangeWhenTilesArriveAndNoRequestLeavesTheMachine) {
  const auto before = settled();
  keep("live-1-dark");
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
  keep("live-2-dark");
  const auto requests = browser_->requests();
  EXPECT_GT(requests.size(), 20u);
  for (const auto& request : requests)
    EXPECT_TRUE(request.starts_with(url_) || request.starts_with("blob:" + url_.substr(0, url_.size() - 1)) ||
                request.starts_with("data:"))
        << request;
}

TEST_F(Page, ControlsShowWhatTheySay) {
  for (int x = 0; x < 4; ++x) map_->make({{x, 2}, {x, 3}});
  auto shown = settled();
  const auto changes = [&](const std::string& name, const std::string& selector) {
    SCOPED_TRACE(name);
    click(selector);
    std::this_thread::sleep_for(300ms);
    auto now = settled();
    keep(name);
    EXPECT_GT(differing(shown, now), 2000u);
    shown = std::move(now);
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
  // thumbs: nothing that is to be tapped is smaller than 44 px, on a tablet held upright
  browser_->resize(820, 1180);
  std::this_thread::sleep_for(1s);
  settled();
  keep("tablet-light");
  const auto small = browser_->run(
      "return [...document.querySelectorAll('button')].filter(b => { const r = b.getBoundingClientRect(); "
      "return r.width > 0 "
      "&& (r.width < 44 || r.height < 44); }).map(b => b.id || b.textContent)");
  EXPECT_TRUE(small.empty()) << small.dump();
  const auto outside = browser_->run(
      "return [...document.querySelectorAll('button,.meter')].filter(b => { const r = "
      "b.getBoundingClientRect(); return r.width "
      "> 0 && (r.left < 0 || r.right > innerWidth || r.bottom > innerHeight); }).map(b => b.id || "
      "b.textContent)");
  EXPECT_TRUE(outside.empty()) << outside.dump();
  click("#theme");
  click("#tilt");
  std::this_thread::sleep_for(1s);
  settled();
  keep("tablet-dark-3d");
}

}  // namespace
}  // namespace overfly::test
