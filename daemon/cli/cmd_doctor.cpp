#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "capture/v4l2/list_cameras.h"
#include "daemon/cli/command.h"
#include "render/gl/context.h"
#include "render/gl/dma_buf.h"
#include "render/gl/precision.h"
#ifdef OVERFLY_HAS_LIBCAMERA
#include "capture/libcamera/libcamera_source.h"
#endif

namespace overfly::cli {
namespace {

// What one part of the machine has to say: facts in order, and what stands in the way of mapping.
struct Section {
  std::string name;
  std::vector<std::pair<std::string, nlohmann::json>> facts;
  std::vector<std::string> problems;

  void add(std::string key, nlohmann::json value) { facts.emplace_back(std::move(key), std::move(value)); }
};

std::vector<std::string> formatsWith(const gl::DeviceInfo& info, bool gl::FormatSupport::*what) {
  std::vector<std::string> out;
  for (int i = 0; i < gl::kFormatCount; ++i) {
    const auto format = static_cast<gl::Format>(i);
    if (info.support(format).*what) out.emplace_back(gl::formatName(format));
  }
  return out;
}

void addLimits(Section& section, const gl::Limits& limits) {
  section.add("texture size", limits.texture_size);
  section.add("texture layers", limits.texture_layers);
  section.add("textures in fragment / compute shaders",
              fmt::format("{} / {}", limits.texture_units, limits.compute_texture_units));
  section.add("invocations per work group", limits.compute_invocations);
  section.add("shared memory, bytes", limits.compute_shared_bytes);
  section.add("images in fragment / compute shaders",
              fmt::format("{} / {}", limits.fragment_images, limits.compute_images));
  section.add("storage blocks in fragment / compute shaders",
              fmt::format("{} / {}", limits.fragment_storage_blocks, limits.compute_storage_blocks));
  section.add("storage block, bytes", limits.storage_block_bytes);
  section.add("render targets", limits.draw_buffers);
}

// What the rectifier and the sweep render into and cannot do without.
void requireFormats(Section& section, const gl::DeviceInfo& info) {
  for (const gl::Format format : {gl::Format::R8, gl::Format::RGBA8, gl::Format::R32F, gl::Format::RGBA16F}) {
    if (!info.support(format).renderable) {
      section.problems.push_back(fmt::format("cannot render into {} textures", gl::formatName(format)));
    }
  }
}

void probe(Section& section, gl::Context& context) {
  const auto precision = gl::probePrecision(context);
  if (!precision) {
    section.problems.push_back(precision.error().message);
    return;
  }
  section.add("highp float, mantissa bits measured in fragment / compute shaders",
              fmt::format("{} / {}", precision->fragment_bits, precision->compute_bits));
  if (std::min(precision->fragment_bits, precision->compute_bits) < gl::kNeededMantissaBits) {
    section.problems.push_back(
        fmt::format("highp float has too few bits, {} are needed", gl::kNeededMantissaBits));
  }
}

Section gpu() {
  Section out;
  out.name = "GPU";
  auto context = gl::Context::create();
  if (!context) {
    out.problems.push_back(context.error().message);
    return out;
  }
  const gl::DeviceInfo& info = context->info();
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
  return out;
}

// Absent cameras stand in nothing's way: a flight can be played.
Section cameras() {
  Section out;
  out.name = "cameras";
  for (const capture::v4l2::FoundCamera& camera : capture::v4l2::listCameras())
    out.add("v4l2 " + camera.path,
            camera.problem.empty() ? fmt::format("{} ({})", camera.card, camera.driver) : camera.problem);
#ifdef OVERFLY_HAS_LIBCAMERA
  out.add("libcamera", capture::libcameraVersion());
  for (const capture::LibcameraCamera& camera : capture::libcameraCameras())
    out.add("libcamera " + camera.id, camera.model);
#else
  out.add("libcamera", "not in this build: libcamera-dev was not there");
#endif
  return out;
}

std::string plain(const nlohmann::json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (!value.is_array()) return value.dump();
  std::string out;
  for (const auto& one : value) out += (out.empty() ? "" : " ") + plain(one);
  return out;
}

void printText(const std::vector<Section>& sections) {
  for (const Section& section : sections) {
    fmt::print("{}\n", section.name);
    for (const auto& [key, value] : section.facts) fmt::print("  {}: {}\n", key, plain(value));
    for (const std::string& problem : section.problems) fmt::print("  PROBLEM: {}\n", problem);
  }
}

void printJson(const std::vector<Section>& sections) {
  nlohmann::ordered_json out;
  for (const Section& section : sections) {
    for (const auto& [key, value] : section.facts) out[section.name][key] = value;
    out[section.name]["problems"] = section.problems;
  }
  fmt::print("{}\n", out.dump(2));
}

void build(CLI::App& command, Context& context) {
  command.footer("Exit status 1 when something stands in the way of mapping.");
  context.onRun(command, [&context]() -> Result<int> {
    const std::vector<Section> sections{gpu(), cameras()};
    if (context.json) {
      printJson(sections);
    } else {
      printText(sections);
    }
    bool good = true;
    for (const Section& section : sections) good = good && section.problems.empty();
    return good ? kOk : kFailed;
  });
}

const Registered registered{"doctor", "what this machine offers, and what stands in the way of mapping",
                            build};

}  // namespace
}  // namespace overfly::cli
