#pragma once
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include "render/preview/previewer.h"
#include "tests/bench/preview/endless_map.h"
#include "tiling/preview/store_tile_source.h"
#include "tiling/store/tile_codec.h"

namespace overfly::bench {

// A map file of 16 x 16 tiles (0.2 km a side at 5 cm) whose tiles are replaced by others of another height,
// in real time, by a thread of its own: the tiles of the finest level in a window around where the camera
// looks, one after the other, ten commits a second, and their parents twice a second. What is written was
// coded before. Exceptions: the file cannot be made.
class ChangingMapFile {
 public:
  ChangingMapFile() : town_(kTiles, kTexels) {
    folder_ = std::filesystem::temp_directory_path() / ("overfly-live-" + std::to_string(getpid()));
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    const preview::MapExtent extent = town_.extent().value();
    tiling::MapMeta meta;
    meta.id = std::string(32, 'a');
    meta.base_zoom = extent.finest_zoom;
    meta.tile_size = kTexels;
    auto made = tiling::MapStore::create(path(), meta);
    if (!made) throw std::runtime_error(made.error().message);
    store_ = std::make_unique<tiling::MapStore>(std::move(*made));
    corner_ = geo::TileLattice::keyAt(extent.min, extent.finest_zoom);
    for (int level = 0; kTiles >> level >= 2; ++level) {
      tiling::Batch batch;
      for (int y = 0; y < kTiles >> level; ++y) {
        for (int x = 0; x < kTiles >> level; ++x) {
          const geo::TileKey key{corner_.zoom - level, (corner_.x >> level) + x, (corner_.y >> level) + y};
          for (std::size_t version = 0; version < 2; ++version) coded_[key][version] = code(key, version);
          batch.tiles.push_back(coded_[key][0]);
        }
      }
      if (const auto done = store_->commit(batch); !done) throw std::runtime_error(done.error().message);
    }
  }
  ~ChangingMapFile() {
    stop();
    store_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  ChangingMapFile(const ChangingMapFile&) = delete;
  ChangingMapFile& operator=(const ChangingMapFile&) = delete;

  [[nodiscard]] std::filesystem::path path() const { return folder_ / "map.overfly"; }
  [[nodiscard]] const EndlessMap& town() const { return town_; }
  [[nodiscard]] const geo::TileKey& corner() const { return corner_; }

  // So many tiles of the finest level a second, a multiple of ten, until stop().
  void start(int rate) {
    written_ = 0;
    thread_ = std::jthread([this, rate](const std::stop_token& stop) { write(stop, rate); });
  }
  void stop() { thread_ = {}; }
  // The middle of the window, in tiles of the finest level from the map's corner.
  void lookAt(int x, int y) {
    x_ = std::clamp(x, kWindow / 2, kTiles - 1 - kWindow / 2);
    y_ = std::clamp(y, kWindow / 2, kTiles - 1 - kWindow / 2);
  }
  // Tiles of the finest level, since start().
  [[nodiscard]] int written() const { return written_; }

  static constexpr int kTiles = 16, kTexels = 256;
  static constexpr int kWindow = 7;     // tiles across: the active area of a level
  static constexpr float kRise = 0.1F;  // metres from one version of a tile to the other

 private:
  tiling::TileWrite code(const geo::TileKey& key, std::size_t version) {
    const auto source = town_.load(key).value();
    tiling::Tile tile;
    tile.key = key;
    tile.size = source->size;
    tile.color = source->color;
    tile.elevation = source->elevation;
    for (float& height : tile.elevation) height += static_cast<float>(version) * kRise;
    tile.confidence = source->confidence;
    tile.views.assign(tile.texels(), 4);
    tile.kind.assign(tile.texels(), tiling::kMeasured);
    std::vector<float> bound;
    if (key.zoom < corner_.zoom) {
      bound = source->elevation_max;
      for (float& height : bound) height += kRise;
    }
    auto out = tiling::encodeTile(tile, tiling::encodeOptions(store_->meta()), bound);
    if (!out) throw std::runtime_error(out.error().message);
    return *out;
  }

  void write(const std::stop_token& stop, int rate) {
    constexpr int kCommits = 10;  // a second
    auto next = preview::Clock::now();
    std::set<geo::TileKey> parents;
    for (int commit = 1; !stop.stop_requested() && rate > 0; ++commit) {
      tiling::Batch batch;
      for (int i = 0; i < rate / kCommits; ++i, ++written_) {
        const int n = written_ % (kWindow * kWindow);
        geo::TileKey key{corner_.zoom, corner_.x + x_ + n % kWindow - kWindow / 2,
                         corner_.y + y_ + n / kWindow - kWindow / 2};
        batch.tiles.push_back(other(key));
        for (int level = 1; kTiles >> level >= 2; ++level)
          parents.insert({key.zoom - level, key.x >> level, key.y >> level});
      }
      if (commit % (kCommits / 2) == 0) {
        for (auto key = parents.rbegin(); key != parents.rend(); ++key) batch.tiles.push_back(other(*key));
        parents.clear();
      }
      if (!store_->commit(batch)) return;  // the count tells
      next += std::chrono::milliseconds(1000 / kCommits);
      std::this_thread::sleep_until(next);
    }
  }
  const tiling::TileWrite& other(const geo::TileKey& key) {
    std::size_t& version = version_[key];
    version = 1 - version;
    return coded_.at(key)[version];
  }

  EndlessMap town_;
  std::filesystem::path folder_;
  geo::TileKey corner_;
  std::unique_ptr<tiling::MapStore> store_;
  std::map<geo::TileKey, std::array<tiling::TileWrite, 2>> coded_;
  std::map<geo::TileKey, std::size_t> version_;
  std::atomic<int> x_ = kTiles / 2, y_ = kTiles / 2, written_ = 0;
  std::jthread thread_;  // last: uses everything above
};

// What was seen on a flight over it.
struct LiveFigures {
  int frames = 0, written = 0, uploads = 0;
  double seconds = 0;
  std::size_t pixels = 0;
  std::size_t holes = 0;     // pixels without the map, although all that is seen lies within it
  std::size_t flickers = 0;  // pixels drawn coarser than both their distance calls for and their place could
                             // be drawn a picture before
  std::size_t coarser = 0;   // pixels drawn coarser than their distance calls for
  std::vector<double> wall_ms, cpu_ms;  // of each update; CPU time of the thread that draws
  std::vector<bool> interrupted;        // in the update the thread was taken off its core, or waited
  std::vector<double> picture_ms;       // from one picture to the next
  int pictures_after = 0;               // until everything written last is drawn
};

inline double threadMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

// Of the calling thread so far, of its own will or not.
inline long contextSwitches() {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return usage.ru_nvcsw + usage.ru_nivcsw;
}

// Flies over the map at 5 m/s and 45 m above the ground for the first half of the time, and rests for the
// other, while `rate` tiles a second are replaced. Real time. Errors: the preview's.
inline Result<LiveFigures> flyOver(gl::Context& context, ChangingMapFile& map, int rate, double seconds,
                                   const preview::ClipCache::Budget& budget) {
  using preview::Clock;
  auto source = tiling::StoreTileSource::open(map.path());
  if (!source) return tl::unexpected(source.error());
  preview::RamCache ram(**source, {.budget_bytes = 256u << 20});
  preview::Previewer previewer(context, ram);
  preview::Look look;
  look.filter = preview::Filter::Trilinear;
  preview::View view;
  view.heading = 0.6;
  view.pitch = -0.87;
  view.fov = geo::radians(45);
  view.width = 480;
  view.height = 270;
  const geo::LocalFrame middle(map.town().middle(EndlessMap::kGround + 45));
  const auto place = [&](double metres) {
    view.position = geo::geodeticFromEcef(middle.ecefFromEnu(
        {(metres - 35) * std::sin(view.heading), (metres - 35) * std::cos(view.heading), 0}));
  };
  place(0);
  if (const auto first = previewer.drawSettled(view, look); !first) return tl::unexpected(first.error());
  const preview::Domain domain = previewer.cache()->domain();
  const double per_metre = preview::levelsPerMetre(view, domain);
  ram.startLoading(std::chrono::milliseconds(250));

  // What can be drawn of each level: the tables that the shader looks up.
  struct Drawable {
    preview::TileWindow window;
    std::vector<preview::ClipCache::TableEntry> table;
  };
  const auto drawable = [&] {
    std::vector<Drawable> out;
    for (int level = 0; level < domain.levels() - 1; ++level)
      out.push_back({previewer.cache()->layout().active(level), previewer.cache()->table(level)});
    return out;
  };
  const auto finest = [&](const std::vector<Drawable>& levels, const Eigen::Vector2d& texel) {
    for (int level = 0; level < domain.levels() - 1; ++level) {
      const double across = std::ldexp(domain.tileSize(), level);
      const int x = static_cast<int>(std::floor(texel.x() / across)),
                y = static_cast<int>(std::floor(texel.y() / across));
      const auto& [window, table] = levels[static_cast<std::size_t>(level)];
      if (window.contains(x, y) &&
          table[static_cast<std::size_t>((y - window.y) * window.width + x - window.x)].slot != 0)
        return level;
    }
    return domain.levels() - 1;
  };

  LiveFigures out;
  map.start(rate);
  const auto begin = Clock::now();
  const auto since = [](Clock::time_point then) {
    return std::chrono::duration<double>(Clock::now() - then).count();
  };
  std::vector<Drawable> before = drawable();
  for (auto last = begin; since(begin) < seconds; ++out.frames) {
    place(5 * std::min(since(begin), seconds / 2));
    const double cpu = threadMilliseconds();
    const long switches = contextSwitches();
    const auto update_begin = Clock::now();
    const auto update = previewer.refine(view, look, budget);
    out.wall_ms.push_back(1e3 * since(update_begin));
    out.cpu_ms.push_back(threadMilliseconds() - cpu);
    out.interrupted.push_back(contextSwitches() != switches);
    if (!update) return tl::unexpected(update.error());
    out.uploads += update->uploads;
    const auto picture = previewer.caster().draw(view, *previewer.frame(), look, *previewer.cache(),
                                                 *previewer.textures(), true);
    if (!picture) return tl::unexpected(picture.error());
    for (const preview::RayHit& hit : picture->hits) {
      ++out.pixels;
      out.holes += hit.found ? 0 : 1;
      if (!hit.found) continue;
      const int called_for = std::max(0, static_cast<int>(std::floor(std::log2(hit.t * per_metre) + 1e-3)));
      out.coarser += hit.level > called_for ? 1 : 0;
      out.flickers += hit.level > std::max(called_for, finest(before, hit.texel)) ? 1 : 0;
    }
    before = drawable();
    const preview::RayHit& seen =
        picture->hits[static_cast<std::size_t>(view.height / 2 * view.width + view.width / 2)];
    const geo::TileKey at = domain.key(0, static_cast<int>(seen.texel.x()) / domain.tileSize(),
                                       static_cast<int>(seen.texel.y()) / domain.tileSize());
    map.lookAt(static_cast<int>(at.x - map.corner().x), static_cast<int>(at.y - map.corner().y));
    out.picture_ms.push_back(1e3 * since(last));
    last = Clock::now();
  }
  out.seconds = since(begin);
  map.stop();
  out.written = map.written();
  // The last change is known after a poll.
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  constexpr int kMost = 1000;
  for (; out.pictures_after < kMost; ++out.pictures_after) {
    const auto frame = previewer.draw(view, look, budget);
    if (!frame) return tl::unexpected(frame.error());
    if (frame->update.settled()) break;
  }
  return out;
}

}  // namespace overfly::bench
