#include <gtest/gtest.h>

#include <filesystem>

#include "tests/accuracy/adjust/run_recorded.h"

namespace overfly::tiling::adjust {
namespace {

TEST(RecordedFlights, SmokeFromRawTelemetryIsAdjustedWhole) {
  const std::string folder = OVERFLY_FLIGHTS_DIR "/brighton-beach-smoke";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no recorded flight " << folder;
  const auto flight = RecordedFlight::read(folder);
  const auto out = run(flight, flight.nominal(3.61, 1.55), verbose());
  EXPECT_EQ(out.adjusted, 9);
  EXPECT_LT(out.summary.rms_px, 0.6);
  EXPECT_LT(out.position_rms_m, 0.3);
  EXPECT_LT(out.rotation_rms_deg, 0.7);  // stated: 0.5 to 0.8 in each axis
  EXPECT_LT(out.ground.residual_px, 0.2);
  EXPECT_NEAR(out.summary.shared.lens[0], flight.reference_camera.fx, 3 * out.summary.sigmas.lens[0]);
}

}  // namespace
}  // namespace overfly::tiling::adjust
