#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "render/preview/clip_layout.h"
#include "render/preview/image_maker.h"
#include "render/preview/ram_cache.h"
#include "render/preview/tile_image.h"

namespace overfly::preview {

// A part of one level's bounds.
struct BoundsPatch {
  int x = 0, y = 0, size = 0;  // texels of the tile (or of the top's mip level), a square
  std::vector<float> values;
};

// GPU memory, as the clip cache sees it.
class TextureSink {
 public:
  virtual ~TextureSink() = default;
  virtual void uploadTile(int slot, const TileImage& image) = 0;
  virtual void uploadBounds(int slot, const BoundsPatch& patch) = 0;
  virtual void uploadTop(const TopImage& top) = 0;
  virtual void uploadTopBounds(int mip, const BoundsPatch& patch) = 0;
};

// Order of loading across levels (DVT, 3.3).
enum class LoadOrder {
  DetailFirst,  // region A of every level, then B of every level: the finest picture as early as can be
  SteadyFirst,  // A and B of a level, then the next finer one: slower to sharpen, steady in flight
};

// The first cache level of one view: which tiles are in GPU memory, and bringing them there, a few a frame.
//
//   1. What is drawn of a level is never taken away by an update: a tile's slot keeps the old content until
//   the
//      new one is complete, and both lie in it between two frames only.
//   2. A tile is drawn only while its parent is: so wherever a tile is, every coarser level is there, too.
//   3. Tiles come in descending level, each level from the centre outwards: first those that are missing,
//   then
//      those that changed, then those whose neighbours changed.
//   4. No bound in GPU memory lies below a finer level's bound that is there, also while the map's parents
//   lag
//      behind their children.
//
// Thread rule: that of its sink; the RAM cache is shared.
class ClipCache {
 public:
  struct Options {
    ClipOptions clip;
    NoData no_data = NoData::Hole;
    LoadOrder order = LoadOrder::DetailFirst;
  };
  struct Budget {
    std::chrono::nanoseconds time = std::chrono::hours(1);  // at least one upload is made whatever it costs
    int uploads = 1 << 30;
    // Tiles' images are made on a thread of the cache's own, and an update uploads those that are there: for
    // a thread that must not be held up.
    bool aside = false;
  };
  struct Update {
    int uploads = 0;  // tiles brought to the GPU
    int waiting = 0;  // not in RAM yet
    int left = 0;     // in RAM, but the budget was spent or the image is not made yet
    bool top = false;
    [[nodiscard]] bool settled() const { return waiting == 0 && left == 0; }
  };
  // What the shaders look up: by level, the active area's tiles row by row.
  struct TableEntry {
    std::uint16_t slot = 0;  // + 1; 0: not there
    std::uint16_t age = 0;   // 0: the newest tile of the map, 255: the oldest
  };

  // `ram` and `sink` outlive the cache; `clock` is for tests.
  ClipCache(
      const Domain& domain, RamCache& ram, TextureSink& sink, const Options& options,
      std::function<Clock::time_point()> clock = [] { return Clock::now(); });
  ~ClipCache();
  ClipCache(const ClipCache&) = delete;
  ClipCache& operator=(const ClipCache&) = delete;

  Update update(const Focus& focus, const Budget& budget);

  [[nodiscard]] const Domain& domain() const { return domain_; }
  [[nodiscard]] const ClipLayout& layout() const { return layout_; }
  // False while the map's top is not there: nothing can be drawn yet.
  [[nodiscard]] bool ready() const { return !top_bounds_.empty(); }
  [[nodiscard]] std::vector<TableEntry> table(int level) const;
  [[nodiscard]] double baseHeight() const { return base_height_m_; }
  // Of all that is in GPU memory, absolute metres.
  [[nodiscard]] double lowest() const { return lowest_m_; }
  [[nodiscard]] double highest() const { return highest_m_; }
  // Finest level that is drawn at a level-0 texel (l_low of 4.2.3).
  [[nodiscard]] int finestAt(const Eigen::Vector2i& texel) const;

 private:
  struct Slot {
    std::optional<geo::TileKey> key;
    std::array<std::uint64_t, 9> generations{};  // of the tile and its neighbours, as uploaded
    std::uint64_t revision = 0;
    std::vector<float> bounds;  // as they are on the GPU
  };
  struct Wanted {
    int level = 0, x = 0, y = 0, slot = 0;
  };
  void request(const Focus& focus);
  [[nodiscard]] std::optional<ImageMaker::Job> topJob() const;
  [[nodiscard]] ImageMaker::Job tileJob(const Wanted& wanted) const;
  [[nodiscard]] bool current(const Wanted& wanted) const;
  [[nodiscard]] bool overtaken(const ImageMaker::Job& job) const;
  void putTop(const ImageMaker::Job& job, const TopImage& top);
  void put(const ImageMaker::Job& job, TileImage image);
  void uploadMade(const Budget& budget, Clock::time_point begin, Update& out);
  [[nodiscard]] bool spent(const Budget& budget, Clock::time_point begin, int steps) const;
  void timed(const std::function<void()>& upload);
  void raise(int level, int x, int y, int size, std::vector<float> bounds);
  [[nodiscard]] bool drawable(int level, int x, int y) const;
  [[nodiscard]] RamCache::Found neighbour(int level, int x, int y) const;

  Domain domain_;
  RamCache& ram_;
  TextureSink& sink_;
  const Options options_;
  std::function<Clock::time_point()> clock_;
  RamCache::Client client_;
  ClipLayout layout_;
  std::vector<Slot> slots_;
  std::array<std::uint64_t, 4> top_generations_{};
  std::vector<std::vector<float>> top_bounds_;  // by mip level
  double base_height_m_ = 0, lowest_m_ = 0, highest_m_ = 0;
  std::uint64_t newest_ = 0, oldest_ = 0;  // revisions of what is in GPU memory
  std::chrono::nanoseconds cost_{0};       // of one upload: the dearest lately
  Clock::time_point now_;
  // Of an update with images made aside, but for its uploads: the dearest lately.
  std::chrono::nanoseconds rest_{0};
  ImageMaker maker_;
};

// How much time a frame may spend on uploads so that the frame rate holds (DVT, 3.5): all that a frame's
// target leaves beside drawing, never less than a twentieth of the target, so that the picture goes on to
// sharpen.
class UploadBudget {
 public:
  explicit UploadBudget(std::chrono::nanoseconds frame_target) : target_(frame_target) {}
  // After a frame: what drawing it took.
  void drawn(std::chrono::nanoseconds drawing);
  [[nodiscard]] std::chrono::nanoseconds next() const;

 private:
  std::chrono::nanoseconds target_;
  std::chrono::nanoseconds drawing_{0};  // smoothed
};

}  // namespace overfly::preview
