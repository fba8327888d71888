#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "daemon/cli/check.h"
#include "daemon/cli/command.h"
#include "daemon/page/assets.h"
#include "render/gl/context.h"
#include "render/gl/devices.h"
#include "render/gl/dma_buf.h"
#include "render/gl/gpu_options.h"
#include "render/gl/precision.h"

namespace overfly::cli {
namespace {

std::vector<std::string> formatsWith(const gl::DeviceInfo& info, bool gl::FormatSupport::*what) {
  std::vector<std::string> out;
  for (int i = 0; i < gl::kFormatCount; ++i) {
    const auto format = static_cast<gl::Format>(i);
    if (info.support(format).*what) out.emplace_back(gl::formatName(format));
  }
  return out;
}

void addLimits(Check& check, const gl::Limits& limits) {
  check.add("texture size", limits.texture_size);
  check.add("texture layers", limits.texture_layers);
  check.add("textures in fragment / compute shaders",
            fmt::format("{} / {}", limits.texture_units, limits.compute_texture_units));
  check.add("invocations per work group", limits.compute_invocations);
  check.add("shared memory, bytes", limits.compute_shared_bytes);
  check.add("images in fragment / compute shaders",
            fmt::format("{} / {}", limits.fragment_images, limits.compute_images));
  check.add("storage blocks in fragment / compute shaders",
            fmt::format("{} / {}", limits.fragment_storage_blocks, limits.compute_storage_blocks));
  check.add("storage block, bytes", limits.storage_block_bytes);
  check.add("render targets", limits.draw_buffers);
}

constexpr const char* kOtherGpu = "use another driver or GPU, or the software rasteriser (gpu.software)";

// What the rectifier and the sweep render into and cannot do without.
void requireFormats(Check& check, const gl::DeviceInfo& info) {
  for (const gl::Format format : {gl::Format::R8, gl::Format::RGBA8, gl::Format::R32F, gl::Format::RGBA16F}) {
    if (!info.support(format).renderable) {
      check.worse(Check::State::Problem,
                  fmt::format("cannot render into {} textures", gl::formatName(format)), kOtherGpu);
    }
  }
}

void probe(Check& check, gl::Context& context) {
  const auto precision = gl::probePrecision(context);
  if (!precision) {
    check.worse(Check::State::Problem, precision.error().message, kOtherGpu);
    return;
  }
  check.add("highp float, mantissa bits measured in fragment / compute shaders",
            fmt::format("{} / {}", precision->fragment_bits, precision->compute_bits));
  if (std::min(precision->fragment_bits, precision->compute_bits) < gl::kNeededMantissaBits) {
    check.worse(Check::State::Problem,
                fmt::format("highp float has too few bits, {} are needed", gl::kNeededMantissaBits),
                kOtherGpu);
  }
}

Check gpu(const config::Gpu& settings) {
  Check out;
  out.name = "GPU";
  const gl::ContextOptions options = gl::optionsFrom(settings);
  out.add("devices", gl::describe(gl::listDevices()));
  out.add("gpu.device", settings.device.empty() ? "any that works" : settings.device);
  auto context = gl::Context::create(options);
  if (!context) {
    out.worse(Check::State::Problem, context.error().message,
              context.error().code == ErrorCode::BadSettings
                  ? "set gpu.device to one of them, or leave it empty"
                  : "install its driver, or Mesa's software rasteriser (libegl-mesa0, libgl1-mesa-dri)");
    return out;
  }
  const gl::DeviceInfo& info = context->info();
  out.finding =
      fmt::format("{}, {}{}", info.renderer, info.version, info.node.empty() ? "" : ", " + info.node);
  out.add("platform", gl::platformName(info.platform));
  out.add("vendor", info.vendor);
  out.add("renderer", info.renderer);
  out.add("version", info.version);
  out.add("software rasteriser", info.software);
  out.add("timer queries", info.gpu_timer);
  out.add("tells of a reset", info.reset_notification);
  out.add("a camera's dma-bufs become textures without a copy", gl::importsDmaBufs(*context));
  addLimits(out, info.limits);
  out.add("renderable", formatsWith(info, &gl::FormatSupport::renderable));
  out.add("filterable", formatsWith(info, &gl::FormatSupport::filterable));
  requireFormats(out, info);
  probe(out, *context);
  if (info.software)
    out.worse(Check::State::Warning, fmt::format("software rasteriser ({})", info.renderer),
              "it maps, at a fraction of a GPU's rate; where there is a GPU, install its driver and see that "
              "the user "
              "overfly may open /dev/dri");
  return out;
}

Check builtIn() {
  Check out;
  out.name = "built in";
  const bool with_terrain = page::find("/maplibre-gl.js") != nullptr;
  out.add("operator page", with_terrain ? "MapLibre GL" : "flat map alone");
  out.finding = fmt::format("overfly {}, operator page {}", OVERFLY_VERSION,
                            with_terrain ? "in 2-D and 3-D" : "in 2-D alone");
  if (!with_terrain)
    out.worse(Check::State::Warning, "the operator page has no terrain and no 3-D",
              "build again with nodejs and npm installed");
  return out;
}

const char* word(Check::State state) {
  switch (state) {
    case Check::State::Ok:
      return "OK";
    case Check::State::Warning:
      return "warning";
    case Check::State::Problem:
      break;
  }
  return "PROBLEM";
}

std::string plain(const nlohmann::ordered_json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (!value.is_array()) return value.dump();
  std::string out;
  for (const auto& one : value) out += (out.empty() ? "" : " ") + plain(one);
  return out;
}

void printText(const std::vector<Check>& checks, bool with_facts) {
  for (const Check& check : checks) {
    fmt::print("{:<8} {:<10} {}{}\n", word(check.state), check.name, check.finding,
               check.advice.empty() ? "" : "; " + check.advice);
    if (!with_facts) continue;
    for (const auto& [key, value] : check.facts) fmt::print("{:19} {}: {}\n", "", key, plain(value));
  }
}

void printJson(const std::vector<Check>& checks) {
  nlohmann::ordered_json out;
  for (const Check& check : checks) {
    auto& node = out[check.name];
    node["state"] = word(check.state);
    node["finding"] = check.finding;
    if (!check.advice.empty()) node["advice"] = check.advice;
    for (const auto& [key, value] : check.facts) node[key] = value;
  }
  fmt::print("{}\n", out.dump(2));
}

constexpr double kListen_s = 2;

void build(CLI::App& command, Context& context) {
  auto all = std::make_shared<bool>(false);
  command.add_flag("--all", *all, "also prints every figure that --json has");
  command.footer("Exit status 1 when something stands in the way of mapping.");
  context.onRun(command, [all, &context]() -> Result<int> {
    const auto loaded = loadSettings(context);
    if (!loaded) return tl::unexpected(loaded.error());
    const auto& settings = loaded->settings;
    const std::vector<Check> checks{builtIn(),
                                    gpu(settings.gpu),
                                    checkCameras(settings),
                                    checkGpio(settings),
                                    checkDisk(settings),
                                    checkClock(),
                                    checkAutopilot(settings, kListen_s)};
    if (context.json)
      printJson(checks);
    else
      printText(checks, *all);
    const bool good =
        std::ranges::none_of(checks, [](const Check& check) { return check.state == Check::State::Problem; });
    return good ? kOk : kFailed;
  });
}

const Registered registered{"doctor", "what this machine offers, and what stands in the way of mapping",
                            build};

}  // namespace
}  // namespace overfly::cli
