// Built without libgpiod.
#include "capture/gpio/gpio_lines.h"

namespace overfly::capture {
namespace {

tl::unexpected<Error> absent() {
  return fail(ErrorCode::Unsupported,
              "this build has no GPIO: install libgpiod-dev and build again, or leave gpio.chip empty");
}

}  // namespace

Result<std::unique_ptr<EdgeLines>> EdgeLines::open(const std::string&, const std::vector<LineWanted>&) {
  return absent();
}
Result<std::unique_ptr<OutputLine>> OutputLine::open(const std::string&, unsigned) { return absent(); }
const char* gpioLibrary() { return "none"; }

}  // namespace overfly::capture
