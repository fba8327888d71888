#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "daemon/governor/operating_table.h"
#include "daemon/tradeoff/flight_reference.h"
#include "daemon/tradeoff/trial.h"
#include "render/gl/context.h"
#include "tiling/mapping/batch_map.h"

namespace overfly::tradeoff {

// A setting of the sweep to be tried.
struct SweepSetting {
  std::string axis, text;
  bool is_default = false;
  tiling::MapperOptions options;
  int coarser = 0;                              // zooms that the map is coarser than the frames allow
  std::optional<daemon::OperatingPoint> point;  // where the governor could choose it in flight
  int reduce = 1;                               // BatchOptions::reduce
};

// The default, every single setting to both sides of it, and combinations from the fastest to the most
// accurate, all beside what maps are made with by default. `quick`: two values an axis and half of the
// combinations.
[[nodiscard]] std::vector<SweepSetting> sweepSettings(bool quick);

struct SweepTrials {
  std::vector<Trial> trials;                   // in the order of the settings; time is per tile of
                                               // the frames' own resolution
  std::vector<daemon::OperatingPoint> points;  // the governor's, with their measured figures
};

// Maps the whole flight with every setting, `repeats` times each after one run to warm up, and compares with
// the reference. The same code as in flight (tiling::mapFlight).
[[nodiscard]] Result<SweepTrials> trySweep(
    gl::Context& context, const FlightReference& reference, const std::vector<SweepSetting>& settings,
    int repeats,
    const std::function<void(std::size_t done, std::size_t total, const std::string&)>& progress);

// The same points as measured on several flights, as one list: mean errors, geometric means of times. The
// lists name the same points in the same order.
[[nodiscard]] std::vector<daemon::OperatingPoint> combined(
    const std::vector<std::vector<daemon::OperatingPoint>>& lists);

}  // namespace overfly::tradeoff
