#include "render/gl/precision.h"

#include "tests/unit/gl/gl_fixture.h"

namespace overfly::gl {
namespace {

using PrecisionTest = test::GlTest;

TEST_F(PrecisionTest, HighpIsEnoughForTheSweepInBothStages) {
  OVERFLY_ASSERT_OK(precision, probePrecision(context()));
  EXPECT_GE(precision.compute_bits, kNeededMantissaBits);
  EXPECT_GE(precision.fragment_bits, kNeededMantissaBits);
  if (context().info().software) {  // llvmpipe computes in IEEE single
    EXPECT_EQ(precision.compute_bits, 23);
    EXPECT_EQ(precision.fragment_bits, 23);
  }
}

}  // namespace
}  // namespace overfly::gl
