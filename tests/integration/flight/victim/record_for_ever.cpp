// Records made frames and raw inputs as fast as it can until it is killed. Prints one byte when it begins.
//   flight_recorder_victim FOLDER
#include <unistd.h>

#include "tests/integration/flight/made_frames.h"

int main(int argc, char** argv) {
  using namespace overfly::capture;
  if (argc != 2 || ::write(STDOUT_FILENO, "x", 1) != 1) return 2;
  FlightInfo info;
  info.made_by = "victim";
  auto recorder = FlightRecorder::create(argv[1], info);
  if (!recorder) return 1;
  for (std::uint64_t i = 0;; ++i) {
    if (!recorder->record(testing_data::madeFrame(i))) return 1;
    TelemetryPacket packet;
    packet.time_ns = static_cast<std::int64_t>(i);
    packet.bytes.assign(i % 250, static_cast<std::uint8_t>(i));
    if (!recorder->record(packet)) return 1;
  }
}
