#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "daemon/link/bundle.h"
#include "daemon/link/token.h"
#include "tests/integration/link/served_map.h"

namespace overfly::test {
namespace {

using Protocol = ServedMap;

std::vector<nlohmann::json> lines(const std::string& text) {
  std::vector<nlohmann::json> out;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) out.push_back(nlohmann::json::parse(line));
  return out;
}

TEST_F(Protocol, ChangesComeCoarseFirstInPagesAndOnce) {
  map_->makeAll();
  serve();
  std::string since = "0";
  std::vector<nlohmann::json> all;
  int pages = 0;
  for (bool done = false; !done && pages < 100; ++pages) {
    const auto answer = fetch(base_ + "/changes?since=" + since + "&layers=color,elevation&max_bytes=600");
    ASSERT_EQ(answer.status, 200) << answer.body;
    for (auto& line : lines(answer.body)) all.push_back(line);
    since = answer.headers.at("overfly-cursor");
    done = answer.headers.at("overfly-done") == "1";
  }
  EXPECT_GT(pages, 3);
  EXPECT_EQ(all.size(), 2u * (16 + 4 + 1));
  for (std::size_t i = 1; i < all.size(); ++i) EXPECT_LE(all[i - 1]["z"], all[i]["z"]);
  EXPECT_TRUE(fetch(base_ + "/changes?since=" + since).body.empty());
  map_->make({{3, 3}}, 1);
  EXPECT_EQ(lines(fetch(base_ + "/changes?layers=color&since=" + since).body).size(), 3u);
  for (const auto* bad :
       {"since=x", "since=1.2", "layers=nothing", "bbox=1,2", "max_bytes=-1", "max_bytes=0"})
    EXPECT_EQ(fetch(base_ + "/changes?" + bad).status, 400) << bad;
  EXPECT_EQ(fetch(base_ + "/changes?since=3&map=another").status, 409);
}

TEST_F(Protocol, BundleGoesOnAtAnyByte) {
  map_->makeAll();
  options_.max_bundle_bytes = 4 << 20;
  serve();
  const auto whole = fetch(base_ + "/bundle?since=0&layers=color,elevation&budget=4000000").body;
  std::vector<link::TileRecord> records;
  std::vector<std::size_t> starts;
  for (std::size_t at = 0; at < whole.size();) {
    const auto length = link::recordLength(std::string_view(whole).substr(at));
    ASSERT_TRUE(length && *length);
    auto record = link::decodeRecord(std::string_view(whole).substr(at, **length));
    ASSERT_TRUE(record);
    starts.push_back(at);
    records.push_back(std::move(*record));
    at += **length;
  }
  ASSERT_EQ(records.size(), 21u);
  const auto reader = map_->store().reader();
  for (const auto& record : records)
    for (const auto& layer : record.layers) {
      const auto stored = reader->read(record.key, layer.encoded.layer);
      ASSERT_TRUE(stored);
      EXPECT_EQ(stored->encoded.bytes, layer.encoded.bytes);
    }
  // cut after every so many bytes, go on from there: the rest is the same
  for (std::size_t cut = 1; cut < whole.size(); cut += whole.size() / 23 + 7) {
    std::size_t last = 0;
    while (last + 1 < starts.size() && starts[last + 1] <= cut) ++last;
    tiling::ChangeCursor cursor;
    if (last > 0) {
      const auto& done = records[last - 1];
      cursor = {done.since, done.until, done.key.zoom, done.revision, false};
    }
    auto place = cursor.text();
    if (cut > starts[last])
      place += "%2B" + std::to_string(cut - starts[last]) + "@" + std::to_string(records[last].revision);
    const auto rest = fetch(base_ + "/bundle?layers=color,elevation&budget=4000000&since=" + place);
    ASSERT_EQ(rest.status, 200) << rest.body;
    ASSERT_EQ(rest.body, whole.substr(cut)) << "cut at " << cut;
  }
}

TEST_F(Protocol, EventsNameWhatChangedAndGoOnAfterALoss) {
  const auto first_revision = map_->make({{0, 0}});
  serve();
  std::thread writer([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(700));
    map_->make({{1, 1}});
  });
  const auto stream = fetch(base_ + "/events", {}, "GET", {}, 2500).body;
  writer.join();
  EXPECT_NE(stream.find("event: hello"), std::string::npos);
  ASSERT_NE(stream.find("event: change"), std::string::npos) << stream;
  const auto data = stream.find("data: ", stream.find("event: change")) + 6;
  const auto change = nlohmann::json::parse(stream.substr(data, stream.find('\n', data) - data));
  bool named = false;
  for (const auto& tile : change["tiles"])
    named =
        named || (tile[0] == "color" && tile[1] == 18 && tile[2] == cell(1, 1).x && tile[3] == cell(1, 1).y);
  EXPECT_TRUE(named);
  // while nobody listened ...
  map_->make({{2, 2}});
  const auto again =
      fetch(base_ + "/events", {"Last-Event-ID: " + std::to_string(first_revision)}, "GET", {}, 800).body;
  EXPECT_NE(again.find("event: change"), std::string::npos);
  EXPECT_NE(again.find(std::to_string(cell(2, 2).x) + "," + std::to_string(cell(2, 2).y)), std::string::npos);
  const auto foreign = fetch(base_ + "/events", {"Last-Event-ID: 1/ffff"}, "GET", {}, 500).body;
  EXPECT_NE(foreign.find("event: resync"), std::string::npos);
}

TEST_F(Protocol, TokenIsAskedForInThreeWaysAndNothingElseOpens) {
  map_->makeAll();
  const auto token = link::makeToken();
  ASSERT_TRUE(link::writeToken(folder_ / "token", token));
  options_.token_file = folder_ / "token";
  serve();
  EXPECT_EQ(fetch(base_ + "/tiles.json").status, 401);
  EXPECT_EQ(fetch(base_ + "/").status, 401);
  EXPECT_EQ(fetch(base_ + "/healthz", {"Authorization: Bearer " + token.substr(1)}).status, 401);
  EXPECT_EQ(fetch(base_ + "/t/wrong/tiles.json").status, 401);
  EXPECT_EQ(fetch(base_ + "/tiles.json", {"Authorization: Bearer " + token}).status, 200);
  EXPECT_EQ(fetch(base_ + "/tiles.json", {"Cookie: overfly_token=" + token}).status, 200);
  const auto by_path = fetch(base_ + "/t/" + token + "/tiles/color.json");
  EXPECT_EQ(by_path.status, 200);
  EXPECT_NE(by_path.body.find("/t/" + token + "/tiles/color/"), std::string::npos);
  EXPECT_FALSE(by_path.headers.contains("access-control-allow-origin"));
  const auto page = fetch(base_ + "/t/" + token + "/");
  EXPECT_NE(page.headers.at("set-cookie").find("HttpOnly; SameSite=Strict"), std::string::npos);
}

TEST_F(Protocol, UnsafeSettingsDoNotStart) {
  map_->makeAll();
  const auto refused = [&] {
    link::LinkServer server(options_, link::showMaps({}));
    const auto started = server.start();
    return !started && started.error().code == ErrorCode::BadSettings;
  };
  options_.address = "0.0.0.0";
  EXPECT_TRUE(refused()) << "beyond loopback without a token";
  options_.token_file = folder_ / "token";
  EXPECT_TRUE(refused()) << "no such token file";
  ASSERT_TRUE(link::writeToken(folder_ / "token", link::makeToken()));
  std::filesystem::permissions(folder_ / "token", std::filesystem::perms(0640));
  EXPECT_TRUE(refused()) << "token readable by others";
  std::filesystem::permissions(folder_ / "token", std::filesystem::perms(0600));
  options_.cors_origins = {"*"};
  EXPECT_TRUE(refused()) << "wildcard with a token";
  options_.cors_origins.clear();
  options_.address = "example.org";
  EXPECT_TRUE(refused()) << "a name is no address";
}

TEST_F(Protocol, ForeignHostNamesAreNotAnsweredWithoutAToken) {
  map_->makeAll();
  serve();
  EXPECT_EQ(fetch(base_ + "/tiles.json", {"Host: rebound.example.org"}).status, 421);
  EXPECT_EQ(fetch(base_ + "/tiles.json", {"Host: localhost:1"}).status, 200);
}

TEST_F(Protocol, APageOfAnotherSiteChangesNothing) {
  map_->makeAll();
  serve();
  EXPECT_EQ(fetch(base_ + "/plan", {"Origin: http://example.org"}, "DELETE").status, 403);
  EXPECT_EQ(fetch(base_ + "/missions", {"Origin: null", "Content-Type: text/plain"}, "POST", "{}").status,
            403);
  EXPECT_EQ(fetch(base_ + "/plan", {"Origin: " + base_}, "DELETE").status, 204);
  EXPECT_EQ(fetch(base_ + "/tiles.json", {"Origin: http://example.org"}).status, 200);
}

TEST_F(Protocol, PlanIsKeptAndCoverageCounts) {
  map_->makeAll();
  map_->addFrames(30);
  serve();
  EXPECT_EQ(fetch(base_ + "/plan").status, 404);
  EXPECT_EQ(fetch(base_ + "/plan", {}, "PUT", "rubbish").status, 400);
  const auto c = map_->centre();
  const double lat = geo::degrees(c.lat), lon = geo::degrees(c.lon), d = 0.0008;
  const nlohmann::json ring{
      {lon - d, lat - d}, {lon + d, lat - d}, {lon + d, lat + d}, {lon - d, lat + d}, {lon - d, lat - d}};
  const nlohmann::json plan{{"type", "Polygon"}, {"coordinates", {ring}}};
  EXPECT_EQ(fetch(base_ + "/plan", {}, "PUT", plan.dump()).status, 204);
  EXPECT_EQ(nlohmann::json::parse(fetch(base_ + "/plan").body), plan);
  const auto one = nlohmann::json::parse(fetch(base_ + "/coverage.json?views=1").body);
  const auto nine = nlohmann::json::parse(fetch(base_ + "/coverage.json?views=9").body);
  EXPECT_TRUE(one["planned"]);
  EXPECT_GT(one["covered_percent"].get<double>(), nine["covered_percent"].get<double>());
  EXPECT_FALSE(nine["gaps"]["features"].empty());
  EXPECT_EQ(fetch(base_ + "/plan", {}, "PUT", std::string(2 << 20, ' ')).status, 413);
  EXPECT_EQ(fetch(base_ + "/plan", {}, "DELETE").status, 204);
  EXPECT_EQ(fetch(base_ + "/plan").status, 404);
}

TEST_F(Protocol, RateLimitHoldsOverAllClients) {
  map_->makeAll();
  options_.max_kbps = 2000;
  serve();
  const auto begin = std::chrono::steady_clock::now();
  std::vector<std::thread> clients;
  std::atomic<std::size_t> bytes{0};
  for (int i = 0; i < 3; ++i)
    clients.emplace_back(
        [&] { bytes += fetch(base_ + "/bundle?since=0&layers=color,elevation&budget=120000").body.size(); });
  for (auto& client : clients) client.join();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const double kbps = static_cast<double>(bytes) * 8 / 1000 / seconds;
  EXPECT_GT(bytes, 300000u);
  EXPECT_LT(kbps, 2000 * 1.35);  // a quarter of a second's burst is allowed
  EXPECT_GT(kbps, 2000 * 0.5);
}

TEST_F(Protocol, PageAndServiceDocumentsAnswer) {
  map_->makeAll();
  serve();
  const auto page = fetch(base_ + "/");
  EXPECT_EQ(page.status, 200);
  EXPECT_NE(page.body.find("overfly"), std::string::npos);
  EXPECT_EQ(page.body.find("https://"), std::string::npos);
  EXPECT_NE(page.headers.at("content-security-policy").find("default-src 'self'"), std::string::npos);
  EXPECT_NE(fetch(base_ + "/connect").body.find(base_ + "/tiles/color/{z}/{x}/{y}.png"), std::string::npos);
  EXPECT_EQ(fetch(base_ + "/healthz").body, "ok\n");
  EXPECT_NE(fetch(base_ + "/metrics").body.find("overfly_link_requests_total "), std::string::npos);
  EXPECT_TRUE(nlohmann::json::parse(fetch(base_ + "/status").body)["map"]["tiles"].get<int>() >= 21);
  // Nothing is drawn where no daemon runs, and that is what it says.
  EXPECT_EQ(fetch(base_ + "/preview.jpg?lat=51&lon=8&height=100").status, 501);
  EXPECT_EQ(fetch(base_ + "/preview/stream?lat=51&lon=8&height=100").status, 501);
  EXPECT_EQ(fetch(base_ + "/preview.jpg?lat=51").status, 400);
  EXPECT_EQ(nlohmann::json::parse(fetch(base_ + "/missions").body)["missions"][0]["id"], "made");
}

}  // namespace
}  // namespace overfly::test
