#pragma once
#include <filesystem>
#include <optional>
#include <string>

#include "capture/camera_model.h"
#include "capture/geo/geodetic.h"
#include "config/error.h"

namespace overfly::capture {

// What a camera.json says (the layout of COLMAP's names): "model" PINHOLE, OPENCV, FULL_OPENCV or
// OPENCV_FISHEYE, "width", "height", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3" ..., and
// "pixel_convention", a text that begins with "OpenCV" where the centre of the first pixel is (0, 0) (also
// assumed when the text is absent) or with "COLMAP" where it is (0.5, 0.5).
struct CameraFile {
  CameraModel model;       // 0.5 is added to cx, cy where the file has OpenCV's convention
  std::string convention;  // what was found, one sentence
  std::optional<geo::Geodetic> enu_origin;
  std::string altitude_kind;  // what the file says its altitudes are
};

// NotFound; BadInput with the key that is wrong.
[[nodiscard]] Result<CameraFile> readCameraFile(const std::filesystem::path& path);

}  // namespace overfly::capture
