#include "render/preview/clip_cache.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace overfly::preview {
namespace {

constexpr int kSpared = 6;  // of a budget's parts, one

std::size_t at(int x, int y, int stride) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(stride) + static_cast<std::size_t>(x);
}

// Tiles of the clip area beside the active area towards which the centre moves: the arm in the main direction
// first, each from its middle outwards.
std::vector<Eigen::Vector2i> regionB(const TileWindow& active, const TileWindow& clip,
                                     const Eigen::Vector2i& centre, const Eigen::Vector2d& motion) {
  std::vector<Eigen::Vector2i> arms[2];
  for (int y = clip.y; y < clip.y + clip.height; ++y) {
    for (int x = clip.x; x < clip.x + clip.width; ++x) {
      if (active.contains(x, y)) continue;
      const bool ahead_x =
          (motion.x() > 0 && x >= active.x + active.width) || (motion.x() < 0 && x < active.x);
      const bool ahead_y =
          (motion.y() > 0 && y >= active.y + active.height) || (motion.y() < 0 && y < active.y);
      if (ahead_x)
        arms[0].emplace_back(x, y);
      else if (ahead_y)
        arms[1].emplace_back(x, y);
    }
  }
  for (int k = 0; k < 2; ++k) {
    std::stable_sort(arms[k].begin(), arms[k].end(), [&](const Eigen::Vector2i& a, const Eigen::Vector2i& b) {
      return std::abs(a[1 - k] - centre[1 - k]) < std::abs(b[1 - k] - centre[1 - k]);
    });
  }
  const int main = std::abs(motion.x()) >= std::abs(motion.y()) ? 0 : 1;
  std::vector<Eigen::Vector2i> out = arms[main];
  out.insert(out.end(), arms[1 - main].begin(), arms[1 - main].end());
  return out;
}

}  // namespace

ClipCache::ClipCache(const Domain& domain, RamCache& ram, TextureSink& sink, const Options& options,
                     std::function<Clock::time_point()> clock)
    : domain_(domain),
      ram_(ram),
      sink_(sink),
      options_(options),
      clock_(std::move(clock)),
      client_(ram.addClient()),
      layout_(domain, options.clip),
      slots_(static_cast<std::size_t>(layout_.slots())) {}

ClipCache::~ClipCache() { ram_.removeClient(client_); }

void ClipCache::request(const Focus& focus) {
  std::vector<geo::TileKey> needed, ahead, prefetch;
  const int coarsest = domain_.levels() - 2;
  for (int level = coarsest; level >= 0; --level) {
    const TileWindow &active = layout_.active(level), &clip = layout_.clip(level);
    const Eigen::Vector2i centre = layout_.centre(level);
    for (const Eigen::Vector2i& t : ringOrder(active, centre, focus.motion))
      needed.push_back(domain_.key(level, t.x(), t.y()));
    std::vector<geo::TileKey>& b = options_.order == LoadOrder::SteadyFirst ? needed : ahead;
    const std::vector<Eigen::Vector2i> region_b = regionB(active, clip, centre, focus.motion);
    for (const Eigen::Vector2i& t : region_b) b.push_back(domain_.key(level, t.x(), t.y()));
    for (const Eigen::Vector2i& t : ringOrder(clip, centre, focus.motion)) {
      if (active.contains(t.x(), t.y()) || std::find(region_b.begin(), region_b.end(), t) != region_b.end())
        continue;
      prefetch.push_back(domain_.key(level, t.x(), t.y()));
    }
  }
  needed.insert(needed.end(), ahead.begin(), ahead.end());
  ram_.want(client_, std::move(needed), std::move(prefetch));
}

RamCache::Found ClipCache::neighbour(int level, int x, int y) const {
  const int across = domain_.tilesAcross(level);
  if (x < 0 || y < 0 || x >= across || y >= across) return {};
  return ram_.find(domain_.key(level, x, y), now_);
}

// None: there are no heights yet.
std::optional<ImageMaker::Job> ClipCache::topJob() const {
  ImageMaker::Job job;
  job.top = true;
  job.level = domain_.levels() - 2;
  job.size = domain_.tileSize();
  for (std::size_t i = 0; i < 4; ++i) {
    const RamCache::Found found = neighbour(job.level, static_cast<int>(i) & 1, static_cast<int>(i) >> 1);
    job.children[i] = found.tile;
    job.generations[i] = found.generation;
  }
  if (ready()) {
    job.base_height_m = base_height_m_;
    return job;
  }
  const auto base = baseHeightOf(job.children);
  if (!base) return std::nullopt;
  job.base_height_m = *base;
  return job;
}

void ClipCache::putTop(const ImageMaker::Job& job, const TopImage& top) {
  std::copy_n(job.generations.begin(), 4, top_generations_.begin());
  if (!ready()) {
    // Heights count from here for as long as this cache lives.
    base_height_m_ = job.base_height_m;
    lowest_m_ = top.lowest_m;
    highest_m_ = top.highest_m;
  } else if (top.highest_m >= top.lowest_m) {
    lowest_m_ = std::min(lowest_m_, top.lowest_m);
    highest_m_ = std::max(highest_m_, top.highest_m);
  }
  top_bounds_.clear();
  for (const TileImage& image : top.levels) top_bounds_.push_back(image.bounds);
  sink_.uploadTop(top);
  for (int i = 0; i < 4; ++i) {
    const geo::TileKey key = domain_.key(job.level, i & 1, i >> 1);
    const Slot& slot = slots_[static_cast<std::size_t>(layout_.slot(job.level, key))];
    if (slot.key == key) raise(job.level, i & 1, i >> 1, job.size, slot.bounds);
  }
}

// Carries bounds of a tile (x, y) of a level, or of a part of it, into the coarser levels where they exceed
// theirs. `x`, `y`, `size`: of the part, in texels of the level from the domain's corner, for levels >= 0.
void ClipCache::raise(int level, int x, int y, int size, std::vector<float> bounds) {
  x *= size;
  y *= size;
  const int tile = domain_.tileSize();
  while (size > 1 && level < domain_.lastLevel()) {
    const int half = size / 2;
    std::vector<float> coarse(static_cast<std::size_t>(half) * static_cast<std::size_t>(half));
    for (int j = 0; j < half; ++j)
      for (int i = 0; i < half; ++i)
        coarse[at(i, j, half)] =
            std::max(std::max(bounds[at(2 * i, 2 * j, size)], bounds[at(2 * i + 1, 2 * j, size)]),
                     std::max(bounds[at(2 * i, 2 * j + 1, size)], bounds[at(2 * i + 1, 2 * j + 1, size)]));
    ++level;
    x /= 2;
    y /= 2;
    std::vector<float>* held = nullptr;
    int stride = tile, slot_index = -1, mip = 0, px = x, py = y;
    if (level < domain_.levels() - 1) {
      const geo::TileKey key = domain_.key(level, x / tile, y / tile);
      slot_index = layout_.slot(level, key);
      Slot& slot = slots_[static_cast<std::size_t>(slot_index)];
      if (slot.key != key) return;  // without a parent it is not drawn; its upload asks its children
      held = &slot.bounds;
      px = x % tile;
      py = y % tile;
    } else {
      if (top_bounds_.empty()) return;
      mip = level - (domain_.levels() - 1);
      held = &top_bounds_[static_cast<std::size_t>(mip)];
      stride = domain_.texelsAcross(level);
    }
    bool raised = false;
    for (int j = 0; j < half; ++j) {
      for (int i = 0; i < half; ++i) {
        float& there = (*held)[at(px + i, py + j, stride)];
        float& here = coarse[at(i, j, half)];
        raised = raised || here > there;
        here = there = std::max(here, there);
      }
    }
    if (!raised) return;
    const BoundsPatch patch{px, py, half, coarse};
    if (slot_index >= 0)
      sink_.uploadBounds(slot_index, patch);
    else
      sink_.uploadTopBounds(mip, patch);
    bounds = std::move(coarse);
    size = half;
  }
}

ImageMaker::Job ClipCache::tileJob(const Wanted& wanted) const {
  ImageMaker::Job job;
  job.key = domain_.key(wanted.level, wanted.x, wanted.y);
  job.level = wanted.level;
  job.x = wanted.x;
  job.y = wanted.y;
  job.size = domain_.tileSize();
  job.base_height_m = base_height_m_;
  job.no_data = options_.no_data;
  for (int j = -1; j <= 1; ++j) {
    for (int i = -1; i <= 1; ++i) {
      const auto k = static_cast<std::size_t>(3 * (j + 1) + i + 1);
      const RamCache::Found found = neighbour(wanted.level, wanted.x + i, wanted.y + j);
      job.block[k] = found.tile;
      job.generations[k] = found.generation;
    }
  }
  return job;
}

void ClipCache::put(const ImageMaker::Job& wanted, TileImage image) {
  const int index = layout_.slot(wanted.level, wanted.key);
  Slot& slot = slots_[static_cast<std::size_t>(index)];
  const int size = image.size, half = size / 2;
  if (wanted.level > 0) {
    for (int c = 0; c < 4; ++c) {
      const geo::TileKey child =
          domain_.key(wanted.level - 1, 2 * wanted.x + (c & 1), 2 * wanted.y + (c >> 1));
      const Slot& below = slots_[static_cast<std::size_t>(layout_.slot(wanted.level - 1, child))];
      if (below.key != child) continue;
      for (int y = 0; y < size; ++y) {
        for (int x = 0; x < size; ++x) {
          float& bound = image.bounds[at((c & 1) * half + x / 2, (c >> 1) * half + y / 2, size)];
          bound = std::max(bound, below.bounds[at(x, y, size)]);
        }
      }
    }
  }
  if (image.highest != kNoHeight)
    highest_m_ = std::max(highest_m_, base_height_m_ + static_cast<double>(image.highest));
  if (image.lowest != -kNoHeight)
    lowest_m_ = std::min(lowest_m_, base_height_m_ + static_cast<double>(image.lowest));
  slot.key = wanted.key;
  slot.generations = wanted.generations;
  slot.revision = wanted.block[4]->revision;
  sink_.uploadTile(index, image);
  slot.bounds = std::move(image.bounds);
  raise(wanted.level, wanted.x, wanted.y, size, slot.bounds);
}

// Nothing of the tile or its neighbours is newer than what was uploaded.
bool ClipCache::current(const Wanted& wanted) const {
  const Slot& slot = slots_[static_cast<std::size_t>(wanted.slot)];
  if (slot.key != domain_.key(wanted.level, wanted.x, wanted.y)) return false;
  for (int k = 0; k < 9; ++k) {
    const RamCache::Found found = neighbour(wanted.level, wanted.x + k % 3 - 1, wanted.y + k / 3 - 1);
    if (found.tile != nullptr && found.generation != slot.generations[static_cast<std::size_t>(k)])
      return false;
  }
  return true;
}

bool ClipCache::spent(const Budget& budget, Clock::time_point begin, int steps) const {
  // What an upload takes is known from those before it: a part is left for the one that takes longer.
  return steps > 0 &&
         (clock_() - begin + cost_ + budget.time / kSpared > budget.time || steps >= budget.uploads);
}

void ClipCache::timed(const std::function<void()>& upload) {
  const Clock::time_point before = clock_();
  upload();
  const std::chrono::nanoseconds took = clock_() - before;
  cost_ = std::max(took, (3 * cost_ + took) / 4);
}

// Something newer than the job's image lies in its slot, or its slot is another tile's by now.
bool ClipCache::overtaken(const ImageMaker::Job& job) const {
  if (job.top)
    return ready() && (job.base_height_m != base_height_m_ ||
                       !std::equal(top_generations_.begin(), top_generations_.end(), job.generations.begin(),
                                   std::less_equal<>()));
  if (!layout_.active(job.level).contains(job.x, job.y)) return true;
  const Slot& slot = slots_[static_cast<std::size_t>(layout_.slot(job.level, job.key))];
  return slot.key == job.key && !std::equal(slot.generations.begin(), slot.generations.end(),
                                            job.generations.begin(), std::less_equal<>());
}

void ClipCache::uploadMade(const Budget& budget, Clock::time_point begin, Update& out) {
  for (int steps = 0; !spent(budget, begin - rest_, steps);) {
    auto made = maker_.take();
    if (!made) return;
    const ImageMaker::Job& job = made->job;
    if (overtaken(job)) continue;
    if (job.top) {
      timed([&] { putTop(job, made->top); });
      out.top = true;
    } else {
      timed([&] { put(job, std::move(made->image)); });
      ++out.uploads;
    }
    ++steps;
  }
}

ClipCache::Update ClipCache::update(const Focus& focus, const Budget& budget) {
  const Clock::time_point begin = clock_();
  now_ = begin;
  layout_.moveTo(focus);
  request(focus);
  Update out;
  const int coarsest = domain_.levels() - 2;

  // The top: as soon as something of its children is there, and whenever one of them changed.
  bool waits = false, changed = false, any = false;
  for (int i = 0; i < 4; ++i) {
    const RamCache::Found found = neighbour(coarsest, i & 1, i >> 1);
    waits = waits || found.state == RamCache::State::Unknown;
    any = any || found.tile != nullptr;
    changed = changed ||
              (found.generation != 0 && found.generation != top_generations_[static_cast<std::size_t>(i)]);
  }
  if (budget.aside) uploadMade(budget, begin, out);
  const Clock::time_point uploaded = clock_();
  if (any && !maker_.has({}, true) && (ready() ? changed && !out.top : !waits)) {
    if (auto job = topJob(); job && budget.aside) {
      maker_.add(std::move(*job));
    } else if (job) {
      putTop(*job, makeTopImage(job->children, job->size, job->base_height_m));
      out.top = true;
    }
  }
  if (!ready()) {
    out.waiting = any || waits ? 1 : 0;
    return out;
  }

  std::vector<Wanted> missing, newer, beside;
  for (int level = coarsest; level >= 0; --level) {
    for (const Eigen::Vector2i& t : ringOrder(layout_.active(level), layout_.centre(level), focus.motion)) {
      const geo::TileKey key = domain_.key(level, t.x(), t.y());
      const Wanted wanted{level, t.x(), t.y(), layout_.slot(level, key)};
      const Slot& slot = slots_[static_cast<std::size_t>(wanted.slot)];
      const RamCache::Found found = ram_.find(key, now_);
      if (found.tile == nullptr) {
        if (found.state == RamCache::State::Unknown) ++out.waiting;
        continue;
      }
      if (found.tile->elevation.empty()) continue;
      if (slot.key != key) {
        missing.push_back(wanted);
      } else if (slot.generations[4] != found.generation) {
        newer.push_back(wanted);
      } else if (!current(wanted)) {
        beside.push_back(wanted);
      }
    }
  }
  missing.insert(missing.end(), newer.begin(), newer.end());
  missing.insert(missing.end(), beside.begin(), beside.end());
  if (budget.aside) {
    out.left = static_cast<int>(missing.size()) + (maker_.has({}, true) ? 1 : 0);
    for (const Wanted& wanted : missing)
      if (!maker_.has(domain_.key(wanted.level, wanted.x, wanted.y), false) && !maker_.add(tileJob(wanted)))
        break;
  } else {
    for (const Wanted& wanted : missing) {
      if (spent(budget, begin, out.uploads)) {
        ++out.left;
        continue;
      }
      timed([&] {
        const ImageMaker::Job job = tileJob(wanted);
        put(job, makeTileImage(job.block, job.base_height_m, job.no_data));
      });
      ++out.uploads;
    }
  }
  newest_ = 0;
  oldest_ = UINT64_MAX;
  for (const Slot& slot : slots_) {
    if (!slot.key) continue;
    newest_ = std::max(newest_, slot.revision);
    oldest_ = std::min(oldest_, slot.revision);
  }
  if (budget.aside) {
    const std::chrono::nanoseconds took = clock_() - uploaded;
    rest_ = std::max(took, (3 * rest_ + took) / 4);
  }
  return out;
}

bool ClipCache::drawable(int level, int x, int y) const {
  for (; level < domain_.levels() - 1; ++level, x /= 2, y /= 2) {
    if (!layout_.active(level).contains(x, y)) return false;
    const geo::TileKey key = domain_.key(level, x, y);
    const Slot& slot = slots_[static_cast<std::size_t>(layout_.slot(level, key))];
    if (slot.key != key) return false;
    // Erased from the map, or beyond its grace.
    if (ram_.find(key, now_).tile == nullptr) return false;
  }
  return ready();
}

std::vector<ClipCache::TableEntry> ClipCache::table(int level) const {
  const TileWindow& window = layout_.active(level);
  std::vector<TableEntry> out;
  for (int y = window.y; y < window.y + window.height; ++y) {
    for (int x = window.x; x < window.x + window.width; ++x) {
      TableEntry entry;
      if (drawable(level, x, y)) {
        const int slot = layout_.slot(level, domain_.key(level, x, y));
        entry.slot = static_cast<std::uint16_t>(slot + 1);
        const double span = static_cast<double>(std::max<std::uint64_t>(newest_ - oldest_, 1));
        entry.age = static_cast<std::uint16_t>(
            255.0 * static_cast<double>(newest_ - slots_[static_cast<std::size_t>(slot)].revision) / span);
      }
      out.push_back(entry);
    }
  }
  return out;
}

int ClipCache::finestAt(const Eigen::Vector2i& texel) const {
  const int shift = std::countr_zero(static_cast<unsigned>(domain_.tileSize()));
  for (int level = 0; level < domain_.levels() - 1; ++level)
    if (drawable(level, texel.x() >> (shift + level), texel.y() >> (shift + level))) return level;
  return domain_.levels() - 1;
}

void UploadBudget::drawn(std::chrono::nanoseconds drawing) {
  drawing_ = drawing_.count() == 0 ? drawing : (3 * drawing_ + drawing) / 4;
}

std::chrono::nanoseconds UploadBudget::next() const { return std::max(target_ - drawing_, target_ / 20); }

}  // namespace overfly::preview
