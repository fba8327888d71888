#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>

#include "capture/camera_model.h"
#include "config/error.h"
#include "tiling/adjust/pose_map.h"

namespace overfly::tiling::adjust {

// A camera as a flight calibrated it, with its uncertainty: what the next flight starts from. Value type.
struct LensProfile {
  capture::CameraModel camera;
  Eigen::Matrix<double, Lens::kSize, 1> sigma = Eigen::Matrix<double, Lens::kSize, 1>::Zero();  // as Lens
  int frames = 0;  // that it was calibrated with
};

// JSON, one file for each camera. NotFound; Corrupt: with what is wrong; Io.
[[nodiscard]] Result<LensProfile> readLensProfile(const std::filesystem::path& file);
[[nodiscard]] Result<void> writeLensProfile(const std::filesystem::path& file, const LensProfile& profile);
// The profile's file name for a camera of that name.
[[nodiscard]] std::string lensProfileName(const std::string& camera_id);

// Whether a profile is of the same camera as `nominal`: size, kind, and a focal length within 10 %.
[[nodiscard]] bool fits(const LensProfile& profile, const capture::CameraModel& nominal);

// Options that start from the profile: a lens moves between flights (heat, focus, a knock), so its stated
// uncertainty is doubled and not taken below 0.1 % of the focal length, half a pixel of the principal point
// and 0.001 of distortion.
[[nodiscard]] AdjustOptions startingFrom(const LensProfile& profile, AdjustOptions options);

// Worth keeping: enough frames, and the flight told more about the focal length than was known before.
[[nodiscard]] bool worthKeeping(const PoseMap::Summary& summary, const capture::CameraModel& nominal,
                                const AdjustOptions& options);

}  // namespace overfly::tiling::adjust
