// The same bits whatever the number of rasteriser threads: the test runs itself again with other settings of
// the driver and compares checksums.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <set>
#include <string>

#include "render/gl/precision.h"
#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/placed_scene.h"

namespace overfly::test {
namespace {

class Determinism : public GlTest {
 protected:
  static std::uint64_t checksum(const tiling::HeightField& field) {
    std::uint64_t hash = 1469598103934665603u;
    const auto mix = [&](const void* data, std::size_t bytes) {
      for (std::size_t i = 0; i < bytes; ++i)
        hash = (hash ^ static_cast<const std::uint8_t*>(data)[i]) * 1099511628211u;
    };
    mix(field.height.data(), field.height.size() * sizeof(float));
    mix(field.confidence.data(), field.confidence.size());
    return hash;
  }
  static std::string childWith(const std::string& environment) {
    const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
    const std::string command = environment + " OVERFLY_CHECKSUM=1 '" + self +
                                "' --gtest_filter=Determinism.PrintsItsChecksum 2>/dev/null";
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), pclose);
    std::string text;
    for (std::array<char, 256> line{}; pipe && std::fgets(line.data(), line.size(), pipe.get()) != nullptr;)
      if (const std::string one = line.data(); one.starts_with("checksum ")) text = one;
    return text;
  }
};

TEST_F(Determinism, PrintsItsChecksum) {
  if (std::getenv("OVERFLY_CHECKSUM") == nullptr) GTEST_SKIP() << "only as a child of the test below";
  const PlacedViews views(context(), fivePhotos(lookOf(hills())));
  const geo::TileFrame frame = localTile(geo::radians(47.38), geo::radians(8.54));
  std::printf("checksum %016llx\n", static_cast<unsigned long long>(checksum(sweepOf(
                                        context(), gridOf(frame, 455), views.at(frame.local(), 455)))));
}

TEST_F(Determinism, OneThreadOrManyGiveTheSameBits) {
  std::set<std::string> results;
  for (const char* environment :
       {"LP_NUM_THREADS=0", "LP_NUM_THREADS=1", "LP_NUM_THREADS=2", "LP_NUM_THREADS=7"}) {
    const std::string result = childWith(environment);
    ASSERT_FALSE(result.empty()) << environment;
    results.insert(result);
  }
  expectAtMost("precision/threads", "different results with 0, 1, 2 and 7 rasteriser threads",
               static_cast<double>(results.size()), 1);
}

// 16-byte vectors have no fused multiply-add units on some processors; results may differ in the last bits,
// but not in what they say.
TEST_F(Determinism, NarrowVectorsSayTheSame) {
  std::set<std::string> results{childWith("LP_NATIVE_VECTOR_WIDTH=128"),
                                childWith("LP_NATIVE_VECTOR_WIDTH=256")};
  expectAtMost("precision/vector-width", "different results with 128 and 256 bit vectors",
               static_cast<double>(results.size()), 1);
}

TEST_F(Determinism, TheGpusRealPrecisionIsThatOfIeeeSingle) {
  const auto precision = gl::probePrecision(context());
  ASSERT_TRUE(precision.has_value()) << precision.error().message;
  expectAtLeast("precision/highp", "mantissa bits of highp as computed, not as claimed",
                std::min(precision->fragment_bits, precision->compute_bits), 23);
}

}  // namespace
}  // namespace overfly::test
