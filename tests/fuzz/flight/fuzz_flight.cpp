#include <cstdint>
#include <cstdlib>
#include <string>

#include "capture/record/detail/flight_text.h"

// Any bytes as one of a flight's text files: values, or an error that says something; what was read can be
// written and read again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace overfly::capture;
  if (size == 0) return 0;
  const std::string text(reinterpret_cast<const char*>(data + 1), size - 1);
  if (data[0] % 3 == 0) {
    const auto info = detail::infoFromText(text);
    if (!info && info.error().message.empty()) std::abort();
    if (info && !detail::infoFromText(detail::infoText(*info))) std::abort();
  } else if (data[0] % 3 == 1) {
    const auto cameras = detail::camerasFromText(text);
    if (!cameras && cameras.error().message.empty()) std::abort();
    if (cameras && !detail::camerasFromText(detail::camerasText(*cameras))) std::abort();
  } else {
    FlightCamera camera;
    camera.id = "main";
    camera.model.width = 64;
    camera.model.height = 48;
    camera.model.fx = camera.model.fy = 50;
    camera.model.cx = 32;
    camera.model.cy = 24;
    const auto frame = detail::frameFromLine(text, {camera}, VerticalDatum::Unknown, "images");
    if (!frame && frame.error().message.empty()) std::abort();
    // No name leads out of the folder, and no pose is less than a number.
    if (frame && std::filesystem::path(frame->file).parent_path() != "images") std::abort();
    if (frame && frame->frame.pose && !frame->frame.pose->position_in_ecef.allFinite()) std::abort();
  }
  return 0;
}
