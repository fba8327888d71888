#include "capture/camera_source.h"

namespace overfly::capture {

void CameraStatus::setProblem(const Error& error) {
  present = false;
  if (problem == error.message) return;
  problem = error.message;
  ++errors[error.code == ErrorCode::Unavailable ? "not there"
           : error.code == ErrorCode::Io        ? "refused"
                                                : "unsuitable"];
}

}  // namespace overfly::capture
