#pragma once
#include <array>
#include <cstdint>
#include <string>

#include "render/gl/format.h"

namespace overfly::gl {

// How the display was reached; all three need no window system.
enum class Platform { Surfaceless, Device, Gbm };
[[nodiscard]] std::string_view platformName(Platform platform);

// What this device offers; the names are OpenGL ES's, counts per shader stage unless said otherwise.
struct Limits {
  int texture_size = 0;
  int texture_layers = 0;
  int texture_units = 0;  // fragment stage
  int compute_texture_units = 0;
  int compute_invocations = 0;  // per work group
  std::array<int, 3> compute_group_count{};
  std::array<int, 3> compute_group_size{};
  int compute_shared_bytes = 0;
  int compute_images = 0;
  int fragment_images = 0;
  int compute_storage_blocks = 0;
  int fragment_storage_blocks = 0;
  std::int64_t storage_block_bytes = 0;
  int uniform_block_bytes = 0;
  int draw_buffers = 0;
};

struct FormatSupport {
  bool renderable = false;  // as a colour (or depth) attachment
  bool filterable = false;  // linear filtering
  bool blendable = false;
};

// A plain report of the chosen device, for `overfly doctor`, logs and decisions.
struct DeviceInfo {
  Platform platform = Platform::Surfaceless;
  std::string node;  // "/dev/dri/renderD128"; empty: none, or the driver does not tell
  std::string vendor;
  std::string renderer;
  std::string version;  // "OpenGL ES 3.2 Mesa 22.3.6"
  std::string shading_language;
  int major = 0, minor = 0;
  bool software = false;            // a CPU rasteriser: llvmpipe, softpipe, SwiftShader
  bool debug = false;               // KHR_debug messages are collected
  bool gpu_timer = false;           // EXT_disjoint_timer_query
  bool reset_notification = false;  // a lost context is noticed by asking, not only by failing calls
  int fragment_highp_bits = 0;      // mantissa bits of highp float in fragment shaders; 23 is IEEE single
  Limits limits;
  std::array<FormatSupport, kFormatCount> formats{};

  [[nodiscard]] const FormatSupport& support(Format format) const {
    return formats[static_cast<std::size_t>(format)];
  }
};

}  // namespace overfly::gl
