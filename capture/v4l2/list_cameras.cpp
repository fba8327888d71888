#include "capture/v4l2/list_cameras.h"

#include <fmt/format.h>

#include "capture/v4l2/detail/node.h"

namespace overfly::capture::v4l2 {

std::vector<FoundCamera> listCameras(const std::shared_ptr<Kernel>& kernel) {
  std::vector<FoundCamera> found;
  for (int i = 0; i < kNodes; ++i) {
    const std::string path = fmt::format("/dev/video{}", i);
    const auto node = Node::open(kernel, path);
    if (node) {
      found.push_back({path, node->card(), node->driver(), {}});
    } else if (node.error().code == ErrorCode::Io) {
      found.push_back({path, {}, {}, node.error().message});
    }
  }
  return found;
}

}  // namespace overfly::capture::v4l2
