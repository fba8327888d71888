#include "render/preview/image_maker.h"

#include <algorithm>
#include <utility>

#include "config/niceness.h"

namespace overfly::preview {

bool ImageMaker::add(Job job) {
  {
    const std::scoped_lock lock(mutex_);
    if (jobs_.size() + made_.size() >= kMost) return false;
    jobs_.push_back(std::move(job));
    if (!thread_.joinable()) thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
  }
  wake_.notify_all();
  return true;
}

bool ImageMaker::has(const geo::TileKey& key, bool top) const {
  const auto same = [&](const Job& job) { return job.top == top && (top || job.key == key); };
  const std::scoped_lock lock(mutex_);
  return std::any_of(jobs_.begin(), jobs_.end(), same) ||
         std::any_of(made_.begin(), made_.end(), [&](const Made& made) { return same(made.job); });
}

std::optional<ImageMaker::Made> ImageMaker::take() {
  const std::scoped_lock lock(mutex_);
  if (made_.empty()) return std::nullopt;
  std::optional<Made> out = std::move(made_.front());
  made_.pop_front();
  return out;
}

void ImageMaker::serve(const std::stop_token& stop) {
  standBack(kPreparingNiceness);
  while (!stop.stop_requested()) {
    Made made;
    {
      std::unique_lock lock(mutex_);
      if (!wake_.wait(lock, stop, [this] { return !jobs_.empty(); })) return;
      made.job = jobs_.front();
    }
    const Job& job = made.job;
    if (job.top)
      made.top = makeTopImage(job.children, job.size, job.base_height_m);
    else
      made.image = makeTileImage(job.block, job.base_height_m, job.no_data);
    const std::scoped_lock lock(mutex_);
    jobs_.pop_front();
    made_.push_back(std::move(made));
  }
}

}  // namespace overfly::preview
