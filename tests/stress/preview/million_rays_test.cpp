// A million rays for each surface; OVERFLY_RAYS takes another number.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/preview/ray_agreement.h"

namespace overfly::preview {
namespace {

class MillionRays : public test::GlTest, public ::testing::WithParamInterface<Surface> {};

TEST_P(MillionRays, EndAndHitWhatTheReferenceHits) {
  const char* asked = std::getenv("OVERFLY_RAYS");
  const std::size_t total = asked != nullptr ? std::stoull(asked) : 1000000;
  constexpr std::size_t kCases = 100;  // RapidCheck's
  const std::size_t each = std::max<std::size_t>(1, total / (kCases * kRayKinds));
  Scene scene(context(), {}, test::holedHeight);
  const auto frame =
      RayFrame::create(scene.domain, scene.map.place(200, 180, 470), scene.cache->baseHeight()).value();
  Agreement sum[kRayKinds];
  EXPECT_TRUE(rc::check([&] {
    const auto seed = *rc::gen::noShrink(rc::gen::inRange<std::uint64_t>(0, std::uint64_t{1} << 60));
    for (int kind = 0; kind < kRayKinds; ++kind) {
      const auto rays = randomRays(seed, kind, each, scene, frame);
      const Agreement a = compare(scene, frame, GetParam(), rays);
      RC_ASSERT(a.gave_up == 0U);
      sum[kind] += a;
    }
  }));
  Agreement all;
  for (int kind = 0; kind < kRayKinds; ++kind) {
    const Agreement& a = sum[kind];
    all += a;
    report(GetParam(), std::to_string(kind), a);
    EXPECT_LE(a.other_end + a.beyond, a.rays / 200) << "kind " << kind;
  }
  report(GetParam(), "all", all);
  EXPECT_LE(all.other_end + all.beyond, all.rays / 1000);
}
INSTANTIATE_TEST_SUITE_P(Surfaces, MillionRays,
                         ::testing::Values(Surface::Blocks, Surface::Linear, Surface::Bicubic));

}  // namespace
}  // namespace overfly::preview
