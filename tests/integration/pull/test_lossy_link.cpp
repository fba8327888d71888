#include <fmt/format.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "daemon/link/token.h"
#include "tests/integration/link/client.h"
#include "tests/integration/link/made_map.h"
#include "tests/integration/pull/lossy_link.h"
#include "tests/integration/pull/mirror_check.h"
#include "tests/integration/pull/program.h"

namespace overfly::test {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr const char* kDrone = "10.77.0.1";
constexpr const char* kGround = "10.77.0.2";

double secondsSince(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

std::uint64_t metric(const std::string& text, const std::string& name) {
  const auto at = text.find("\n" + name + " ");
  return at == std::string::npos ? 0 : std::strtoull(text.c_str() + at + name.size() + 2, nullptr, 10);
}

// The colour of the coarsest level, all of it.
bool overviewIsThere(const std::filesystem::path& drone, const std::filesystem::path& mirror) {
  const auto a = tiling::MapReader::open(drone), b = tiling::MapReader::open(mirror);
  if (!a || !b) return false;
  const auto zooms = a->zoomRange(tiling::Layer::Color);
  const auto keys = a->keys(zooms->first, tiling::Layer::Color, {}, 1000);
  for (const auto& key : *keys)
    if (!b->read(key, tiling::Layer::Color)) return false;
  return true;
}

// 5 % loss, 200 kbit/s, 300 ms there and back, and blackouts. Short: three of 9 s; OVERFLY_BLACKOUTS=N:
// N of 30 s.
TEST(LossyLink, PullEndsWithExactlyTheDronesTilesAtMostOfTheRate) {
  const auto drone = Namespace::make(kDrone), ground = Namespace::make(kGround);
  if (!drone || !ground) GTEST_SKIP() << "network namespaces or TUN devices are not permitted here";
  const char* full = std::getenv("OVERFLY_BLACKOUTS");
  const int blackouts = full ? std::atoi(full) : 3;
  const auto dark = full ? 30s : 9s;
  const auto light = full ? 20s : 7s;
  const int side = full ? 12 : 4;

  std::string pattern = std::filesystem::temp_directory_path() / "overfly-lossy-XXXXXX";
  const std::filesystem::path folder = mkdtemp(pattern.data());
  MadeMap map(folder / "drone.overfly", geo::TileKey{18, 137001, 87001}, side);
  map.makeAll();
  const auto size = sizeOf(*map.store().reader());
  const auto token = link::makeToken();
  ASSERT_TRUE(link::writeToken(folder / "token", token));

  const LinkQuality quality;
  LossyLink radio(*drone, *ground, quality);
  std::unique_ptr<Program> server, pull;
  drone->run([&] {
    server =
        std::make_unique<Program>(std::vector<std::string>{OVERFLY_PROGRAM, "serve", folder / "drone.overfly",
                                                           "--listen", std::string(kDrone) + ":8420", "--set",
                                                           "link.token_file=" + (folder / "token").string()},
                                  folder / "serve.err");
  });
  ASSERT_FALSE(server->line(20s).empty());
  const auto base = fmt::format("http://{}:8420", kDrone);
  const auto begin = Clock::now();
  const auto delivered_before = radio.deliveredToGround();
  ground->run([&] {
    pull = std::make_unique<Program>(
        std::vector<std::string>{OVERFLY_PROGRAM, "pull", base, folder / "mirror", "--once", "--json",
                                 "--token-file", folder / "token"},
        folder / "pull.err");
  });

  double dark_s = 0;
  std::uint64_t overview_bytes = 0;
  int done = 0;
  auto switch_at = begin + light;
  bool is_dark = false;
  std::optional<int> status;
  nlohmann::json told;
  const auto limit = 20 * 60.0;
  while (!(status = pull->wait(0ms)) && secondsSince(begin) < limit) {
    if (Clock::now() >= switch_at && (is_dark || done < blackouts)) {
      is_dark = !is_dark;
      radio.blackout(is_dark);
      if (is_dark) {
        ++done;
        dark_s += std::chrono::duration<double>(dark).count();
      }
      switch_at = Clock::now() + (is_dark ? dark : light);
    }
    if (overview_bytes == 0 && overviewIsThere(folder / "drone.overfly", folder / "mirror" / "drone.overfly"))
      overview_bytes = radio.deliveredToGround() - delivered_before;
    if (const auto line = pull->line(20ms); !line.empty()) told = nlohmann::json::parse(line);
  }
  const double wall_s = secondsSince(begin);
  for (std::string line; !(line = pull->line(100ms)).empty();) told = nlohmann::json::parse(line);
  std::ifstream errors(folder / "pull.err");
  ASSERT_EQ(status, 0) << std::string(std::istreambuf_iterator<char>(errors), {});
  std::string metrics;
  drone->run([&] { metrics = fetch(base + "/metrics", {"Authorization: Bearer " + token}).body; });

  EXPECT_EQ(done, blackouts) << "the map was too small to meet all blackouts";
  expectSame(folder / "drone.overfly", folder / "mirror" / "drone.overfly");
  // No layer came twice. Of those that had begun when a connection broke, what the server had sent and the
  // ground had not received is what had to be sent again.
  EXPECT_EQ(told["layers"], size.layers);
  const auto reconnects = told["reconnects"].get<std::uint64_t>();
  const auto sent =
      metric(metrics, "overfly_link_sent_bytes_total") - 320 * metric(metrics, "overfly_link_requests_total");
  const auto received = told["bytes"].get<std::uint64_t>();
  const auto again = sent > received ? sent - received : 0;
  EXPECT_LE(again, std::max<std::uint64_t>(1, reconnects) * size.largest);
  const double light_s = wall_s - dark_s;
  const double goodput = static_cast<double>(size.bytes) * 8 / light_s / quality.bits_per_s;
  // The short form shares its processors with other tests; the full one has them to itself.
  EXPECT_GE(goodput, full ? 0.7 : 0.5);
  EXPECT_LE(overview_bytes, 100'000u);
  EXPECT_GT(overview_bytes, 0u);
  fmt::print(
      "{:.2f} MB of tiles in {:.0f} s, {:.0f} s of them dark ({} blackouts): goodput {:.0f} % of {:.0f} "
      "kbit/s; "
      "{} reconnects, {} bytes sent again ({} a reconnect, largest tile layer {}), {} bytes resumed; "
      "overview after {} "
      "bytes; {} packets lost\n",
      static_cast<double>(size.bytes) * 1e-6, wall_s, dark_s, done, goodput * 100, quality.bits_per_s * 1e-3,
      reconnects, again, reconnects ? again / reconnects : 0, size.largest,
      told["resumed_bytes"].get<std::uint64_t>(), overview_bytes, radio.lostPackets());
  pull.reset();
  server.reset();
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
}

}  // namespace
}  // namespace overfly::test
