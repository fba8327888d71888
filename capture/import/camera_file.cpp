#include "capture/import/camera_file.h"

#include <fmt/format.h>

#include <cmath>

#include "capture/record/files.h"
#include "capture/record/json_value.h"

namespace overfly::capture {

Result<CameraFile> readCameraFile(const std::filesystem::path& path) {
  const auto text = readText(path, 1u << 20);
  if (!text) return tl::unexpected(text.error());
  const auto wrong = [&](const std::string& what) {
    return fail(ErrorCode::BadInput, fmt::format("{}: {}", path.string(), what));
  };
  const auto json = parseJson(*text);
  if (!json || !json->is_object()) return wrong("it is not a JSON object");

  CameraFile file;
  CameraModel& model = file.model;
  const std::string name = textIn(*json, "model").value_or("");
  std::vector<const char*> coefficients;
  if (name == "PINHOLE") {
    model.kind = CameraModel::Kind::Pinhole;
  } else if (name == "OPENCV" || name == "FULL_OPENCV") {
    model.kind = CameraModel::Kind::RadialTangential;
    coefficients = {"k1", "k2", "p1", "p2"};
    if (member(*json, "k3")) coefficients.push_back("k3");
    if (member(*json, "k4")) coefficients.insert(coefficients.end(), {"k4", "k5", "k6"});
  } else if (name == "OPENCV_FISHEYE") {
    model.kind = CameraModel::Kind::Fisheye;
    coefficients = {"k1", "k2", "k3", "k4"};
  } else {
    return wrong(fmt::format(
        "its \"model\" is \"{}\"; PINHOLE, OPENCV, FULL_OPENCV and OPENCV_FISHEYE are understood", name));
  }
  for (const auto& [key, into] : {std::pair{"width", &model.width}, std::pair{"height", &model.height}}) {
    const auto value = integerIn(*json, key);
    if (!value || *value < 1 || *value > 1'000'000)
      return wrong(fmt::format("its \"{}\" is not a size", key));
    *into = static_cast<int>(*value);
  }
  for (const auto& [key, into] : {std::pair{"fx", &model.fx}, std::pair{"fy", &model.fy},
                                  std::pair{"cx", &model.cx}, std::pair{"cy", &model.cy}}) {
    const auto value = numberIn(*json, key);
    if (!value) return wrong(fmt::format("its \"{}\" is not a number", key));
    *into = *value;
  }
  for (const char* key : coefficients) {
    const auto value = numberIn(*json, key);
    if (!value) return wrong(fmt::format("its \"{}\" is not a number", key));
    model.distortion.push_back(*value);
  }
  const auto convention = textIn(*json, "pixel_convention");
  if (convention && convention->starts_with("COLMAP")) {
    file.convention = "the camera file puts the centre of the first pixel at (0.5, 0.5), as here";
  } else if (!convention || convention->starts_with("OpenCV")) {
    model.cx += 0.5;
    model.cy += 0.5;
    file.convention =
        convention
            ? "the camera file has OpenCV's convention, first pixel centre (0, 0): 0.5 was added to cx and cy"
            : "the camera file names no pixel convention; OpenCV's, first pixel centre (0, 0), was assumed: "
              "0.5 "
              "was added to cx and cy";
  } else {
    return wrong("its \"pixel_convention\" begins neither with OpenCV nor with COLMAP");
  }
  if (const auto problem = model.problem()) return wrong(*problem);

  if (const Json* origin = member(*json, "enu_origin")) {
    const auto lat = numberIn(*origin, "lat"), lon = numberIn(*origin, "lon"), alt = numberIn(*origin, "alt");
    if (!lat || !lon || !alt || std::abs(*lat) > 90 || std::abs(*lon) > 360 || std::abs(*alt) > 20000) {
      return wrong("its \"enu_origin\" is not a place on Earth");
    }
    file.enu_origin = geo::Geodetic{geo::radians(*lat), geo::radians(*lon), *alt};
    file.altitude_kind = textIn(*origin, "alt_kind").value_or("");
  }
  return file;
}

}  // namespace overfly::capture
