#pragma once
#include <optional>
#include <string>

#include "capture/pose.h"

namespace overfly::capture {

// nullopt when a pose from a file can be one: near the Earth's surface (-20 to +100 km, coarsely), quaternion
// of unit length within 1 %, covariance finite without negative variances. Else one sentence. A quaternion
// that is off by more than rounding is normalised.
[[nodiscard]] std::optional<std::string> checkPose(Pose& pose);

}  // namespace overfly::capture
