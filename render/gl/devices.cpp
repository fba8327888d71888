#include "render/gl/devices.h"

#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <filesystem>

#include "render/gl/detail/open_context.h"

namespace overfly::gl {
namespace {

std::filesystem::path resolved(std::string_view path) {
  std::error_code code;
  auto out = std::filesystem::canonical(path, code);
  return code ? std::filesystem::path(path) : out;
}

std::string lower(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

}  // namespace

std::vector<Device> listDevices() {
  std::vector<Device> out;
  for (const detail::Opening& opening : detail::deviceOpenings()) {
    Device device;
    device.node = opening.node;
    if (const auto state = detail::openAt(opening, false)) {
      device.renderer = (*state)->info.renderer;
      device.software = (*state)->info.software;
    } else {
      device.problem = state.error().message;
    }
    out.push_back(std::move(device));
  }
  return out;
}

std::optional<std::size_t> pickDevice(std::span<const Device> devices, std::string_view wanted) {
  std::size_t number = 0;
  const auto [end, problem] = std::from_chars(wanted.data(), wanted.data() + wanted.size(), number);
  if (problem == std::errc() && end == wanted.data() + wanted.size())
    return number < devices.size() ? std::optional(number) : std::nullopt;
  const auto meant = [&, node = resolved(wanted), part = lower(wanted)](const Device& device) {
    if (wanted.starts_with('/')) return !device.node.empty() && resolved(device.node) == node;
    return !part.empty() && lower(device.renderer).find(part) != std::string::npos;
  };
  const auto found = std::find_if(devices.begin(), devices.end(), meant);
  if (found == devices.end()) return std::nullopt;
  return static_cast<std::size_t>(found - devices.begin());
}

std::vector<std::string> describe(std::span<const Device> devices) {
  std::vector<std::string> out;
  for (const Device& device : devices)
    out.push_back(fmt::format("{}: {}{}", out.size(),
                              device.problem.empty() ? device.renderer : "unusable, " + device.problem,
                              device.node.empty() ? "" : fmt::format(" ({})", device.node)));
  return out;
}

}  // namespace overfly::gl
