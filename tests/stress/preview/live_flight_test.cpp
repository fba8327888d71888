// In real time over a map file that is written meanwhile; what it costs is told by bench_preview's
// LiveFlight.
#include "tests/bench/preview/live_flight.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "tests/unit/gl/gl_fixture.h"

namespace overfly::preview {
namespace {

class LiveFlight : public test::GlTest {};

// Fifty tiles a second of those in sight are replaced: no pixel is ever without ground or drawn coarser than
// just before because of it, and what was written last is soon in the picture.
TEST_F(LiveFlight, OverAMapThatChangesHasNoHolesAndDoesNotFlicker) {
  bench::ChangingMapFile map;
  ClipCache::Budget budget;
  budget.time = std::chrono::milliseconds(3);
  budget.aside = true;
  OVERFLY_ASSERT_OK(figures, bench::flyOver(context(), map, 50, 12, budget));
  std::printf("%d pictures in %.1f s, %d tiles written, %d uploaded, all of it drawn after %d more\n",
              figures.frames, figures.seconds, figures.written, figures.uploads, figures.pictures_after);
  EXPECT_GT(figures.written, 400);  // or it was no such flight, on whatever machine
  EXPECT_GT(figures.uploads, 0);
  EXPECT_GT(figures.frames, 3);
  EXPECT_EQ(figures.holes, 0U) << "of " << figures.pixels << " pixels";
  EXPECT_EQ(figures.flickers, 0U) << "of " << figures.pixels << " pixels";
  EXPECT_LT(figures.pictures_after, 1000);
}

}  // namespace
}  // namespace overfly::preview
