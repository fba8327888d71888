#include "capture/replay/replay_source.h"
#include "tests/integration/flight/made_frames.h"
#include "tests/unit/capture/frame_source_compliance.h"

namespace overfly::capture {
namespace {

std::shared_ptr<testing_data::TemporaryFolder> flightOnDisk() {
  static const auto folder = [] {
    auto made = std::make_shared<testing_data::TemporaryFolder>();
    auto recorder = FlightRecorder::create(*made / "flight", {}).value();
    for (std::uint64_t i = 0; i < 10; ++i) {
      if (!recorder.record(testing_data::madeFrame(i))) std::abort();
    }
    return made;
  }();
  return folder;
}

SourceKind replay(const char* name, double speed, bool loop) {
  SourceKind kind;
  kind.name = name;
  kind.make = [=] {
    ReplayOptions options;
    options.speed = speed;
    options.loop = loop;
    return std::make_unique<ReplaySource>(*flightOnDisk() / "flight", options);
  };
  kind.make_absent = [] { return std::make_unique<ReplaySource>(std::filesystem::path("/no/such/flight")); };
  kind.frames = loop ? 25 : 10;
  kind.interval = std::chrono::milliseconds(speed > 0 ? static_cast<int>(100 / speed) : 0);
  return kind;
}

INSTANTIATE_TEST_SUITE_P(Replay, FrameSourceCompliance,
                         testing::Values(replay("TrueTime", 1, false), replay("TenTimes", 10, true),
                                         replay("AsFastAsTaken", 0, false)),
                         sourceKindName);

}  // namespace
}  // namespace overfly::capture
