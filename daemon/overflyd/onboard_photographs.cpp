#include "daemon/overflyd/onboard_photographs.h"

#include <utility>

namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;

constexpr auto kRefreshInterval = 5s;

}  // namespace

Result<std::unique_ptr<OnboardPhotographs>> OnboardPhotographs::open(const std::filesystem::path& map,
                                                                     double ground_m) {
  auto reader = tiling::MapReader::open(map);
  if (!reader) return tl::unexpected(reader.error());
  auto frames = tiling::FrameProjectors::create(*reader, map, ground_m);
  if (!frames) return tl::unexpected(frames.error());
  return std::unique_ptr<OnboardPhotographs>(
      new OnboardPhotographs(std::move(*reader), map, ground_m, std::move(*frames)));
}

void OnboardPhotographs::refresh() {
  const auto now = std::chrono::steady_clock::now();
  if (now - refreshed_ < kRefreshInterval) return;
  refreshed_ = now;
  if (auto frames = tiling::FrameProjectors::create(map_, file_, ground_m_)) frames_ = std::move(*frames);
}

bool OnboardPhotographs::readNext() {
  if (!picture_ || picture_->image) return false;
  auto image = frames_.load(picture_->id, picture_->width, picture_->height);
  if (image)
    picture_->image = std::move(*image);
  else
    picture_.reset();
  return true;
}

Result<std::vector<preview::Projector>> OnboardPhotographs::choose(const preview::ProjectorQuery& query) {
  return frames_.choose(query);
}

Result<preview::ProjectorImage> OnboardPhotographs::load(std::uint64_t id, int width, int height) {
  if (picture_ && picture_->image && picture_->id == id && picture_->width == width &&
      picture_->height == height) {
    preview::ProjectorImage image = std::move(*picture_->image);
    picture_.reset();
    return image;
  }
  // The first that is asked for: it is the nearest. A picture of an earlier view makes room.
  if (!picture_ || picture_->image) picture_ = Picture{id, width, height, std::nullopt};
  return fail(ErrorCode::Unavailable, "the photograph is being read");
}

}  // namespace overfly::daemon
