#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "tiling/preview/frame_projectors.h"

namespace overfly::daemon {

// A mission's own frames as the photographs of the views drawn on board. The GPU thread chooses among them
// and takes pictures that are there; they are read from their files and made by whoever asks for the view,
// one at a time: no more than one picture is in memory here. One thread at a time.
class OnboardPhotographs final : public preview::ProjectorSource {
 public:
  // Of the map's frames as they are now; `ground_m` is about the ground's height. Errors: the store's.
  [[nodiscard]] static Result<std::unique_ptr<OnboardPhotographs>> open(const std::filesystem::path& map,
                                                                        double ground_m);

  // Takes up frames and poses that the map has got since, and tries unreadable pictures again, where it last
  // did so a while ago. A map that cannot be read now leaves the frames that there were.
  void refresh();
  // Reads and makes the picture that load() could not give; false: none is asked for. One that cannot be had
  // is not chosen any more.
  bool readNext();

  // On the GPU thread.
  [[nodiscard]] Result<std::vector<preview::Projector>> choose(const preview::ProjectorQuery& query) override;
  // Unavailable, until readNext() has made it.
  [[nodiscard]] Result<preview::ProjectorImage> load(std::uint64_t id, int width, int height) override;

 private:
  struct Picture {
    std::uint64_t id = 0;
    int width = 0, height = 0;
    std::optional<preview::ProjectorImage> image;  // none: to be read
  };
  OnboardPhotographs(tiling::MapReader map, std::filesystem::path file, double ground_m,
                     tiling::FrameProjectors frames)
      : map_(std::move(map)), file_(std::move(file)), ground_m_(ground_m), frames_(std::move(frames)) {}

  tiling::MapReader map_;
  std::filesystem::path file_;
  double ground_m_;
  tiling::FrameProjectors frames_;
  std::chrono::steady_clock::time_point refreshed_ = std::chrono::steady_clock::now();
  std::optional<Picture> picture_;
};

}  // namespace overfly::daemon
