#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <vector>

#include "capture/frame.h"
#include "render/preview/projector.h"
#include "tiling/index/frame_index.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {

// The frames whose photographs suit a view (thesis, 6.2.1): those whose view pyramid meets the view's frustum
// (from the R*-tree), whose viewing direction is at most `max_angle` from the view's, and of these the
// `count` taken nearest to the view point, nearest first; of equal distances the lower id. Those for which
// `excluded` holds do not count. A function of the set of frames; reentrant while nobody changes the index.
[[nodiscard]] std::vector<const IndexedFrame*> chooseProjectors(
    const FrameIndex& index, const preview::ProjectorQuery& query,
    const std::function<bool(std::uint64_t)>& excluded = {});

// A frame's picture as a projector shows it: without the lens's distortion, scaled to fill `width` x
// `height`. BadInput: an image that cannot be read, or is not the camera's size. Reentrant.
[[nodiscard]] Result<preview::ProjectorImage> undistortedImage(const capture::Image& image,
                                                               const capture::CameraModel& camera, int width,
                                                               int height);

// The photographs of a map's frames, read from their files when a view calls for them. One thread at a time.
class FrameProjectors : public preview::ProjectorSource {
 public:
  // The pixels of a frame of the map. NotFound: it has none any more.
  using Load = std::function<Result<capture::Image>(const FrameRecord&)>;

  // Of all frames of the map that have a pose and an image as they are now; `ground_m` is about the ground's
  // height. `map_file` tells what the frames' relative paths start from. Errors: the store's.
  [[nodiscard]] static Result<FrameProjectors> create(const MapReader& map,
                                                      const std::filesystem::path& map_file, double ground_m);
  // The same from any frames; `load` fetches their images.
  FrameProjectors(const geo::TileLattice& lattice, const std::vector<FrameRecord>& frames, double ground_m,
                  Load load);

  [[nodiscard]] Result<std::vector<preview::Projector>> choose(const preview::ProjectorQuery& query) override;
  [[nodiscard]] Result<preview::ProjectorImage> load(std::uint64_t id, int width, int height) override;
  [[nodiscard]] std::size_t size() const { return index_.size(); }

 private:
  FrameIndex index_;
  std::map<std::uint64_t, FrameRecord> frames_;
  std::set<std::uint64_t> unreadable_;
  Load load_;
};

}  // namespace overfly::tiling
