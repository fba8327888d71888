#include "daemon/overflyd/live.h"

namespace overfly::daemon {

Result<std::unique_ptr<capture::CameraSource>> makeCamera(const config::Settings&) {
  return fail(ErrorCode::BadSettings,
              "source.kind: live cameras are not in this build; allowed: replay, scene");
}

}  // namespace overfly::daemon
