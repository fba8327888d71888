#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Which GPUs there are, and which of them is meant.
namespace overfly::gl {

struct Device {
  std::string node;      // "/dev/dri/renderD128"; empty: it has none, or its driver does not tell
  std::string renderer;  // "V3D 4.2", "llvmpipe (LLVM 15.0.6, 256 bits)"; empty: not opened, or `problem`
  bool software = false;
  std::string problem;  // why OpenGL ES 3.1 cannot be had of it
};

// All that EGL and the kernel offer, in their order; each is opened for its name, which may take a while.
[[nodiscard]] std::vector<Device> listDevices();

// Index of the device that `wanted` means: its number in the list, its node (or a link to it, as in
// /dev/dri/by-path), or a part of its renderer's name in any case, the first one that has it.
[[nodiscard]] std::optional<std::size_t> pickDevice(std::span<const Device> devices, std::string_view wanted);

// A line each for people: "0: V3D 4.2 (/dev/dri/renderD128)", "1: unusable, no EGL display".
[[nodiscard]] std::vector<std::string> describe(std::span<const Device> devices);

}  // namespace overfly::gl
