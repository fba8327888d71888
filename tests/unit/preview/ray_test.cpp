#include <gtest/gtest.h>

#include <string>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/preview/ray_agreement.h"

namespace overfly::preview {
namespace {

using Rays1000Km = test::GlTest;
class Rays : public test::GlTest, public ::testing::WithParamInterface<Surface> {};

// tests/stress/preview has the million.
TEST_P(Rays, OfEveryKindHitWhatTheReferenceHits) {
  Scene scene(context(), {}, test::holedHeight);
  const auto frame =
      RayFrame::create(scene.domain, scene.map.place(200, 180, 470), scene.cache->baseHeight()).value();
  Agreement all;
  for (int kind = 0; kind < kRayKinds; ++kind) {
    const auto rays = randomRays(20 + static_cast<std::uint64_t>(kind), kind, 700, scene, frame);
    const Agreement a = compare(scene, frame, GetParam(), rays);
    report(GetParam(), std::to_string(kind), a);
    EXPECT_EQ(a.gave_up, 0U) << kind;
    EXPECT_LE(a.other_end + a.beyond, a.rays / 200) << "kind " << kind;
    all += a;
  }
  EXPECT_LE(all.other_end + all.beyond, all.rays / 1000);
}
// The textures and rays of one place, in lattices whose origins are there and 1,000 km away.
TEST_F(Rays1000Km, AreAsExactAsNearTheOrigin) {
  for (const double away_deg : {0.0, 9.0}) {
    SyntheticMap::Options options;
    options.lattice = geo::TileLattice::local({geo::radians(47.6712 - away_deg), geo::radians(9.1743), 0});
    Scene scene(context(), options, test::townHeight);
    const auto frame =
        RayFrame::create(scene.domain, scene.map.place(200, 180, 470), scene.cache->baseHeight()).value();
    const auto rays = randomRays(7, 0, 1024, scene, frame);
    const Agreement a = compare(scene, frame, Surface::Linear, rays);
    EXPECT_GT(a.hits, 300u);
    EXPECT_LE(a.other_end + a.beyond, a.rays / 200) << away_deg;
  }
}
INSTANTIATE_TEST_SUITE_P(Surfaces, Rays,
                         ::testing::Values(Surface::Blocks, Surface::Linear, Surface::Bicubic));

}  // namespace
}  // namespace overfly::preview
