#include "tiling/adjust/lens_profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>

namespace overfly::tiling::adjust {
namespace {

using capture::CameraModel;
using nlohmann::json;

constexpr int kFormat = 1;
constexpr int kLeastFrames = 10;

const char* nameOf(CameraModel::Kind kind) {
  switch (kind) {
    case CameraModel::Kind::Pinhole:
      return "pinhole";
    case CameraModel::Kind::RadialTangential:
      return "radial_tangential";
    case CameraModel::Kind::Fisheye:
      return "fisheye";
  }
  return "";
}

std::optional<CameraModel::Kind> kindNamed(const std::string& name) {
  for (const auto kind :
       {CameraModel::Kind::Pinhole, CameraModel::Kind::RadialTangential, CameraModel::Kind::Fisheye})
    if (name == nameOf(kind)) return kind;
  return std::nullopt;
}

}  // namespace

std::string lensProfileName(const std::string& camera_id) {
  std::string name = "camera-";
  for (const char c : camera_id)
    name += (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ? c : '_';
  return name + ".json";
}

Result<LensProfile> readLensProfile(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) return fail(ErrorCode::NotFound, fmt::format("there is no camera profile {}", file.string()));
  const auto wrong = [&](const std::string& what) {
    return fail(ErrorCode::Corrupt,
                fmt::format("{}: {}; remove it, and the next flight makes a new one", file.string(), what));
  };
  const json read = json::parse(in, nullptr, false);
  if (!read.is_object()) return wrong("not a JSON object");
  LensProfile profile;
  try {
    if (read.at("format").get<int>() != kFormat) return wrong("a format that is not known");
    const auto kind = kindNamed(read.at("kind").get<std::string>());
    if (!kind) return wrong("an unknown kind of lens");
    CameraModel& c = profile.camera;
    c.kind = *kind;
    c.width = read.at("width").get<int>();
    c.height = read.at("height").get<int>();
    c.fx = read.at("fx").get<double>();
    c.fy = read.at("fy").get<double>();
    c.cx = read.at("cx").get<double>();
    c.cy = read.at("cy").get<double>();
    c.distortion = read.at("distortion").get<std::vector<double>>();
    const auto sigma = read.at("sigma").get<std::vector<double>>();
    if (sigma.size() != static_cast<std::size_t>(Lens::kSize)) return wrong("\"sigma\" has not 8 values");
    for (int i = 0; i < Lens::kSize; ++i) profile.sigma[i] = sigma[static_cast<std::size_t>(i)];
    profile.frames = read.at("frames").get<int>();
  } catch (const json::exception& error) {
    return wrong(error.what());
  }
  if (const auto problem = profile.camera.problem()) return wrong(*problem);
  if (!profile.sigma.allFinite() || profile.sigma.minCoeff() < 0) return wrong("\"sigma\" is not a sigma");
  return profile;
}

Result<void> writeLensProfile(const std::filesystem::path& file, const LensProfile& profile) {
  const CameraModel& c = profile.camera;
  const json text{{"format", kFormat},
                  {"kind", nameOf(c.kind)},
                  {"width", c.width},
                  {"height", c.height},
                  {"fx", c.fx},
                  {"fy", c.fy},
                  {"cx", c.cx},
                  {"cy", c.cy},
                  {"distortion", c.distortion},
                  {"sigma", std::vector<double>(profile.sigma.data(), profile.sigma.data() + Lens::kSize)},
                  {"frames", profile.frames}};
  // Written beside and moved over: a reader or a power cut never meets half a file.
  std::filesystem::path beside = file;
  beside += ".new";
  std::ofstream out(beside);
  out << text.dump(2) << '\n';
  out.close();
  std::error_code code;
  if (out) std::filesystem::rename(beside, file, code);
  if (!out || code) return fail(ErrorCode::Io, fmt::format("{} cannot be written", file.string()));
  return {};
}

bool fits(const LensProfile& profile, const CameraModel& nominal) {
  const CameraModel& c = profile.camera;
  // The adjustment itself turns a pinhole into a radial-tangential lens.
  const bool kinds = (c.kind == CameraModel::Kind::Fisheye) == (nominal.kind == CameraModel::Kind::Fisheye);
  return kinds && c.width == nominal.width && c.height == nominal.height &&
         std::abs(c.fx / nominal.fx - 1) < 0.1;
}

AdjustOptions startingFrom(const LensProfile& profile, AdjustOptions options) {
  Eigen::Matrix<double, Lens::kSize, 1> least = Eigen::Matrix<double, Lens::kSize, 1>::Constant(0.001);
  least.head<3>() << 0.001 * profile.camera.fx, 0.5, 0.5;
  options.sigma_lens = (2 * profile.sigma).cwiseMax(least).eval();
  for (int i = 3; i < Lens::kSize; ++i)
    if (profile.sigma[i] == 0) (*options.sigma_lens)[i] = 0;  // was not adjusted, and is not now
  return options;
}

bool worthKeeping(const PoseMap::Summary& summary, const CameraModel& nominal, const AdjustOptions& options) {
  const double known = options.sigma_lens ? (*options.sigma_lens)[0] : options.sigma_focal * nominal.fx;
  return summary.adjusted >= kLeastFrames && summary.sigmas.lens[0] > 0 &&
         summary.sigmas.lens[0] < 0.95 * known;
}

}  // namespace overfly::tiling::adjust
