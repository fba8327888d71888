#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "config/description.h"
#include "config/load.h"
#include "config/sample.h"

// Any bytes as a settings file: problems, or settings whose own sample reads back as the same.
//   build/fuzz/tests/fuzz/settings/fuzz_settings -max_total_time=60 tests/fuzz/settings/corpus
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace overfly::config;
  const auto loaded = loadText({reinterpret_cast<const char*>(data), size}, "fuzz");
  if (!loaded) {
    if (loaded.error().empty() || errorFrom(loaded.error()).message.empty()) std::abort();
    return 0;
  }
  const auto again = loadText(sampleText(loaded->settings), "sample");
  if (!again || !differences(loaded->settings, again->settings).empty()) std::abort();
  return 0;
}
