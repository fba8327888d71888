#include "tiling/preview/frame_projectors.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "capture/image_decode.h"
#include "capture/record/files.h"
#include "tiling/rectify/undistortion.h"

namespace overfly::tiling {
namespace {

constexpr double kNear_m = 1;
constexpr std::uint64_t kLargestFile = 256u << 20;

Frustum frustumOf(const preview::View& view, double far_m) {
  const geo::LocalFrame local(view.position);
  const Eigen::Matrix3d enu_from_camera = view.enuFromCamera();
  std::array<Eigen::Vector3d, 8> corners;
  for (std::size_t i = 0; i < 8; ++i) {
    const double depth = i < 4 ? kNear_m : std::max(far_m, 2 * kNear_m);
    const double x = (i % 4 == 1 || i % 4 == 2 ? 0.5 : -0.5) * view.width / view.focal();
    const double y = (i % 4 >= 2 ? 0.5 : -0.5) * view.height / view.focal();
    corners[i] = local.ecefFromEnu(enu_from_camera * Eigen::Vector3d(x, y, 1) * depth);
  }
  return Frustum::fromCorners(corners);
}

Eigen::Vector3d axisOf(const capture::Pose& pose) {
  return pose.ecef_from_camera.normalized() * Eigen::Vector3d::UnitZ();
}

}  // namespace

std::vector<const IndexedFrame*> chooseProjectors(const FrameIndex& index,
                                                  const preview::ProjectorQuery& query,
                                                  const std::function<bool(std::uint64_t)>& excluded) {
  const geo::LocalFrame local(query.view.position);
  const Eigen::Vector3d place = geo::ecefFromGeodetic(query.view.position);
  const Eigen::Vector3d axis =
      local.enuFromEcefRotation().transpose() * query.view.enuFromCamera() * Eigen::Vector3d::UnitZ();
  std::vector<const IndexedFrame*> chosen = index.framesInFrustum(frustumOf(query.view, query.far_m));
  std::erase_if(chosen, [&](const IndexedFrame* frame) {
    return axis.dot(axisOf(frame->pose)) < std::cos(query.max_angle) || (excluded && excluded(frame->id));
  });
  // The index answers in the order of ids.
  std::stable_sort(chosen.begin(), chosen.end(), [&place](const IndexedFrame* a, const IndexedFrame* b) {
    return (a->pose.position_in_ecef - place).squaredNorm() <
           (b->pose.position_in_ecef - place).squaredNorm();
  });
  chosen.resize(std::min(chosen.size(), static_cast<std::size_t>(std::max(query.count, 0))));
  return chosen;
}

Result<preview::ProjectorImage> undistortedImage(const capture::Image& image,
                                                 const capture::CameraModel& camera, int width, int height) {
  if (image.width != camera.width || image.height != camera.height)
    return fail(ErrorCode::BadInput, fmt::format("an image of {} x {} pixels through a lens for {} x {}",
                                                 image.width, image.height, camera.width, camera.height));
  const auto plan = planUndistortion(camera);
  if (!plan) return tl::unexpected(plan.error());
  preview::ProjectorImage out;
  capture::CameraModel& pinhole = out.pinhole;
  pinhole = plan->pinhole;
  const double sx = static_cast<double>(width) / pinhole.width,
               sy = static_cast<double>(height) / pinhole.height;
  pinhole.width = width;
  pinhole.height = height;
  pinhole.fx *= sx;
  pinhole.cx *= sx;
  pinhole.fy *= sy;
  pinhole.cy *= sy;
  // Averaged down to less than twice the resolution that is wanted, then sampled.
  int divide = 1;
  while (divide < 8 && 2 * divide * std::max(sx, sy) <= 1) divide *= 2;
  const auto pixels = capture::decodeImageWords(image, divide);
  if (!pixels) return tl::unexpected(pixels.error());
  cv::Mat at_x(height, width, CV_32F), at_y(height, width, CV_32F), reached(height, width, CV_8U);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto at = plan->sourceFromPinhole({(x + 0.5) / sx, (y + 0.5) / sy});
      const bool inside =
          at && at->x() >= 0 && at->y() >= 0 && at->x() <= camera.width && at->y() <= camera.height;
      reached.at<std::uint8_t>(y, x) = inside ? 255 : 0;
      at_x.at<float>(y, x) = inside ? static_cast<float>(at->x() / divide - 0.5) : 0;
      at_y.at<float>(y, x) = inside ? static_cast<float>(at->y() / divide - 0.5) : 0;
    }
  }
  out.rgba.resize(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  cv::Mat rgba(height, width, CV_8UC4, out.rgba.data());
  const cv::Mat words(pixels->height, pixels->width, CV_8UC4, const_cast<std::uint8_t*>(pixels->rgbx.data()));
  cv::remap(words, rgba, at_x, at_y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::insertChannel(reached, rgba, 3);
  return out;
}

Result<FrameProjectors> FrameProjectors::create(const MapReader& map, const std::filesystem::path& map_file,
                                                double ground_m) {
  const auto meta = map.meta();
  if (!meta) return tl::unexpected(meta.error());
  const auto lattice = geo::TileLattice::parse(meta->lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  const auto frames = map.frames();
  if (!frames) return tl::unexpected(frames.error());
  const std::filesystem::path folder = std::filesystem::absolute(map_file).parent_path();
  return FrameProjectors(*lattice, *frames, ground_m,
                         [folder](const FrameRecord& frame) -> Result<capture::Image> {
                           auto bytes = capture::readFile(folder / frame.path, kLargestFile);
                           if (!bytes) return tl::unexpected(bytes.error());
                           const auto size = capture::jpegSize(*bytes);
                           if (!size) return tl::unexpected(size.error());
                           capture::Image image;
                           image.width = size->width;
                           image.height = size->height;
                           image.bytes = std::move(*bytes);
                           return image;
                         });
}

FrameProjectors::FrameProjectors(const geo::TileLattice& lattice, const std::vector<FrameRecord>& frames,
                                 double ground_m, Load load)
    : index_(lattice), load_(std::move(load)) {
  std::vector<IndexedFrame> indexed;
  for (const FrameRecord& frame : frames) {
    if (!frame.pose || frame.state == FrameState::Refused || frame.state == FrameState::Dropped) continue;
    // Only view pyramids are asked for, so the anchor of footprints plays no part.
    auto made = makeIndexedFrame(frame.id, frame.camera, *frame.pose, 0, lattice, 0.5, ground_m);
    if (!made) continue;  // its lens or pose is unusable
    indexed.push_back(std::move(*made));
    frames_[frame.id] = frame;
  }
  index_.rebuild(std::move(indexed));
}

Result<std::vector<preview::Projector>> FrameProjectors::choose(const preview::ProjectorQuery& query) {
  std::vector<preview::Projector> out;
  for (const IndexedFrame* frame :
       chooseProjectors(index_, query, [this](std::uint64_t id) { return unreadable_.contains(id); }))
    out.push_back({frame->id, frame->pose.position_in_ecef, frame->pose.ecef_from_camera});
  return out;
}

Result<preview::ProjectorImage> FrameProjectors::load(std::uint64_t id, int width, int height) {
  const auto frame = frames_.find(id);
  if (frame == frames_.end()) return fail(ErrorCode::NotFound, fmt::format("the map has no frame {}", id));
  const auto image = load_(frame->second);
  auto made = image ? undistortedImage(*image, frame->second.camera, width, height)
                    : Result<preview::ProjectorImage>(tl::unexpected(image.error()));
  if (!made) unreadable_.insert(id);
  return made;
}

}  // namespace overfly::tiling
