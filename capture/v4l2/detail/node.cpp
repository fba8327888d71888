#include "capture/v4l2/detail/node.h"

#include <fmt/format.h>
#include <grp.h>
#include <linux/videodev2.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <optional>

namespace overfly::capture::v4l2 {
namespace {

std::string groupOf(const std::string& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return "video";
  group entry{};
  group* found = nullptr;
  char text[1024];
  if (getgrgid_r(status.st_gid, &entry, text, sizeof text, &found) != 0 || found == nullptr)
    return fmt::format("{}", status.st_gid);
  return found->gr_name;
}

tl::unexpected<Error> openFailed(const std::string& path, int error) {
  switch (error) {
    case ENOENT:
    case ENXIO:
    case ENODEV:
      return fail(ErrorCode::Unavailable,
                  fmt::format("there is no camera at {}: plug it in, or set source.path to one of "
                              "/dev/v4l/by-id or /dev/v4l/by-path",
                              path));
    case EACCES:
    case EPERM:
      return fail(ErrorCode::Io, fmt::format("{} may not be opened: it belongs to the group {}; add the "
                                             "daemon's user to it (usermod -aG {} overfly) and restart",
                                             path, groupOf(path), groupOf(path)));
    case EBUSY:
      return fail(ErrorCode::Unavailable, fmt::format("{} is in use by another program (fuser -v {} says "
                                                      "which): end that one",
                                                      path, path));
    default:
      return fail(ErrorCode::Io, fmt::format("{} cannot be opened: {}", path, std::strerror(error)));
  }
}

std::string textOf(const __u8* bytes, std::size_t size) {
  const auto* text = reinterpret_cast<const char*>(bytes);
  return {text, strnlen(text, size)};
}

}  // namespace

int Node::lastError() { return errno == 0 ? EIO : errno; }

Result<Node> Node::open(std::shared_ptr<Kernel> kernel, const std::string& path) {
  const int fd = kernel->open(path.c_str());
  if (fd < 0) return openFailed(path, lastError());
  Node node(std::move(kernel), path, fd);
  v4l2_capability found{};
  if (const int error = node.call(VIDIOC_QUERYCAP, found); error != 0) {
    if (error == ENODEV) return openFailed(path, error);
    return fail(ErrorCode::Unsupported,
                fmt::format("{} is not a video device; v4l2-ctl --list-devices shows those that are", path));
  }
  node.card_ = textOf(found.card, sizeof found.card);
  node.driver_ = textOf(found.driver, sizeof found.driver);
  const __u32 can = (found.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? found.device_caps : found.capabilities;
  const bool takes = (can & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)) != 0;
  if (!takes || (can & V4L2_CAP_STREAMING) == 0) {
    return fail(ErrorCode::Unsupported,
                fmt::format("{} ({}) takes no pictures: it is another node of its device; v4l2-ctl "
                            "--list-devices shows them all",
                            path, node.card_));
  }
  node.planes_ = (can & V4L2_CAP_VIDEO_CAPTURE) == 0;
  return node;
}

Result<Node> Node::openFirst(const std::shared_ptr<Kernel>& kernel) {
  std::optional<Error> refused;
  for (int i = 0; i < kNodes; ++i) {
    auto node = open(kernel, fmt::format("/dev/video{}", i));
    if (node) return node;
    const bool says_more = node.error().code == ErrorCode::Io;
    if (says_more && !refused) refused = node.error();
  }
  if (refused) return tl::unexpected(*refused);
  return fail(ErrorCode::Unavailable,
              "there is no camera below /dev/video*: plug one in, or set source.path");
}

tl::unexpected<Error> Node::failed(const std::string& doing, int error) const {
  if (error == ENODEV || error == EBUSY) return openFailed(path_, error);
  if (error == ENOLINK || error == ENOLCK)
    return fail(ErrorCode::Unavailable,
                fmt::format("{} ({}) has no signal: is its sensor connected?", path_, card_));
  return fail(ErrorCode::Io,
              fmt::format("{} ({}) did not {}: {}", path_, card_, doing, std::strerror(error)));
}

}  // namespace overfly::capture::v4l2
