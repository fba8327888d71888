#include "daemon/governor/throttling.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <optional>

namespace overfly::daemon {
namespace {

namespace fs = std::filesystem;

// The firmware's own word carries no frequency; its caps leave about this much.
constexpr double kFirmwareCap = 0.6;

std::optional<std::string> wordIn(const fs::path& file) {
  std::ifstream stream(file);
  std::string word;
  if (!(stream >> word)) return std::nullopt;
  return word;
}

std::optional<double> numberIn(const fs::path& file, int base = 10) {
  const auto word = wordIn(file);
  if (!word) return std::nullopt;
  std::uint64_t value = 0;
  const char* begin = word->data() + (base == 16 && word->starts_with("0x") ? 2 : 0);
  if (std::from_chars(begin, word->data() + word->size(), value, base).ec != std::errc{}) return std::nullopt;
  return static_cast<double>(value);
}

template <typename Visit>
void forEachIn(const fs::path& folder, const std::string& prefix, Visit visit) {
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code))
    if (entry.path().filename().string().starts_with(prefix)) visit(entry.path());
}

bool coolsByFrequency(const std::string& type) {
  return type == "Processor" || type.find("cpufreq") != std::string::npos ||
         type.find("devfreq") != std::string::npos || type.find("gpufreq") != std::string::npos;
}

}  // namespace

Throttling readThrottling(const fs::path& sys) {
  Throttling result;
  forEachIn(sys / "class/thermal", "cooling_device", [&](const fs::path& device) {
    const auto type = wordIn(device / "type");
    const auto now = numberIn(device / "cur_state"), most = numberIn(device / "max_state");
    if (!type || !now || !most || *now <= 0 || *most <= 0 || !coolsByFrequency(*type)) return;
    // The states divide the frequencies; the deepest one leaves about a third.
    const double left = 1 - 0.67 * std::min(1.0, *now / *most);
    if (left >= result.headroom) return;
    result = {left, fmt::format("the kernel cools by {} ({:.0f} of {:.0f})", *type, *now, *most)};
  });
  if (result.headroom < 1) {  // where the frequencies are told, they say it exactly
    double least = 1;
    bool known = false;
    forEachIn(sys / "devices/system/cpu/cpufreq", "policy", [&](const fs::path& policy) {
      const auto limit = numberIn(policy / "scaling_max_freq"), full = numberIn(policy / "cpuinfo_max_freq");
      if (!limit || !full || *full <= 0) return;
      known = true;
      least = std::min(least, *limit / *full);
    });
    if (known) result.headroom = std::max(least, 0.05);
  }
  // Bits 1 to 3: capped, throttled, soft temperature limit, at this moment.
  const auto firmware = numberIn(sys / "devices/platform/soc/soc:firmware/get_throttled", 16);
  if (firmware && (static_cast<unsigned>(*firmware) & 0xEU) != 0 && kFirmwareCap < result.headroom)
    result = {kFirmwareCap,
              fmt::format("the firmware reports throttling (0x{:x})", static_cast<unsigned>(*firmware))};
  return result;
}

}  // namespace overfly::daemon
