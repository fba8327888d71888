#include "capture/libcamera/detail/manager.h"

namespace overfly::capture::lc {

std::shared_ptr<libcamera::CameraManager> sharedManager() {
  static std::mutex mutex;
  static std::weak_ptr<libcamera::CameraManager> running;
  const std::scoped_lock lock(mutex);
  if (auto manager = running.lock()) return manager;
  std::shared_ptr<libcamera::CameraManager> manager(new libcamera::CameraManager,
                                                    [](libcamera::CameraManager* ended) {
                                                      ended->stop();
                                                      delete ended;
                                                    });
  if (manager->start() != 0) return nullptr;
  running = manager;
  return manager;
}

}  // namespace overfly::capture::lc
