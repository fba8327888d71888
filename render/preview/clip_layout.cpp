#include "render/preview/clip_layout.h"

#include <algorithm>
#include <cmath>

namespace overfly::preview {
namespace {

constexpr int kBridge = 3;

int modulo(std::int64_t value, int by) {  // (3.8): never negative
  const auto rest = static_cast<int>(value % by);
  return rest < 0 ? rest + by : rest;
}

// `size` cells around the centre, moved to lie within [0, across).
int begin(double centre, int size, int across) {
  const int first = static_cast<int>(std::floor(centre - 0.5 * size + 0.5));
  return std::clamp(first, 0, across - size);
}

}  // namespace

ClipLayout::ClipLayout(const Domain& domain, const ClipOptions& options)
    : domain_(domain), options_(options) {
  options_.active = std::max(options_.active, 2);
  const int count = domain.levels() - 1;  // the top has a texture of its own
  levels_.resize(static_cast<std::size_t>(count));
  const auto full = [&](int level) { return std::min(options_.active, domain.tilesAcross(level)); };
  int all = 0;
  for (int l = 0; l < count; ++l) all += full(l) * full(l);
  const bool fits = all <= options_.max_slots;
  for (int l = 0; l < count; ++l) {
    Level& level = levels_[static_cast<std::size_t>(l)];
    level.bridge = fits ? full(l) : std::min(kBridge, domain.tilesAcross(l));
    level.bridge_offset = slots_;  // Omega(l)
    slots_ += level.bridge * level.bridge;
  }
  if (fits) return;
  const int place = options_.active * options_.active;
  depth_ = std::clamp((options_.max_slots - slots_) / place, 1, count);
  stack_offset_ = slots_;
  slots_ += depth_ * place;
}

void ClipLayout::moveTo(const Focus& focus) {
  for (std::size_t l = 0; l < levels_.size(); ++l) {
    Level& level = levels_[l];
    const int index = static_cast<int>(l), across = domain_.tilesAcross(index);
    level.in_stack =
        depth_ > 0 && across >= options_.active && index >= focus.finest && index < focus.finest + depth_;
    const double side = std::ldexp(domain_.tileSize(), index);
    const Eigen::Vector2d centre = focus.centres[l] / side;
    // Levels finer than any point seen calls for hold nothing.
    const int size = index < focus.finest ? 0 : std::min(acrossOf(level), across);
    const auto window = [&](int extent) {
      extent = std::min(extent, across);
      return TileWindow{begin(centre.x(), extent, across), begin(centre.y(), extent, across), extent, extent};
    };
    level.active = window(size);
    level.clip = size == 0 ? level.active : window(size + 2 * options_.margin);
    level.centre = {std::clamp(static_cast<int>(std::floor(centre.x())), 0, across - 1),
                    std::clamp(static_cast<int>(std::floor(centre.y())), 0, across - 1)};
  }
}

int ClipLayout::slot(int level, const geo::TileKey& key) const {
  const Level& at = levels_[static_cast<std::size_t>(level)];
  const int k = acrossOf(at);
  const int within = modulo(key.y, k) * k + modulo(key.x, k);
  return (at.in_stack ? stack_offset_ + (level % depth_) * k * k : at.bridge_offset) + within;
}

std::vector<Eigen::Vector2i> ringOrder(const TileWindow& window, const Eigen::Vector2i& centre,
                                       const Eigen::Vector2d& motion) {
  struct Item {
    int ring;
    double ahead;
    Eigen::Vector2i tile;
  };
  std::vector<Item> items;
  for (int y = window.y; y < window.y + window.height; ++y) {
    for (int x = window.x; x < window.x + window.width; ++x) {
      const Eigen::Vector2i away(x - centre.x(), y - centre.y());
      items.push_back({away.cwiseAbs().maxCoeff(), away.cast<double>().dot(motion), {x, y}});
    }
  }
  std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
    return a.ring != b.ring ? a.ring < b.ring : a.ahead > b.ahead;
  });
  std::vector<Eigen::Vector2i> out;
  out.reserve(items.size());
  for (const Item& item : items) out.push_back(item.tile);
  return out;
}

}  // namespace overfly::preview
