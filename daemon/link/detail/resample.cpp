#include "daemon/link/detail/resample.h"

#include <algorithm>
#include <cmath>

namespace overfly::link {
namespace {

struct Mix {
  double r = 0, g = 0, b = 0, a = 0, weight = 0;
  void add(const std::uint8_t* texel, double w) {
    const double alpha = w * texel[3];
    r += alpha * texel[0];
    g += alpha * texel[1];
    b += alpha * texel[2];
    a += alpha;
    weight += w;
  }
  void write(std::uint8_t* to) const {
    if (a <= 0) return;
    const auto byte = [](double v) {
      return static_cast<std::uint8_t>(std::clamp(std::lround(v), 0L, 255L));
    };
    to[0] = byte(r / a);
    to[1] = byte(g / a);
    to[2] = byte(b / a);
    to[3] = byte(a / weight);
  }
};

// The four texels around (x, y) with their weights, clamped to the image.
template <typename Visit>
void aroundPoint(int width, int height, double x, double y, Visit visit) {
  const double fx = x - 0.5, fy = y - 0.5;
  const int x0 = static_cast<int>(std::floor(fx)), y0 = static_cast<int>(std::floor(fy));
  const double ax = fx - x0, ay = fy - y0;
  for (int i = 0; i < 4; ++i) {
    const double w = ((i & 1) ? ax : 1 - ax) * ((i & 2) ? ay : 1 - ay);
    visit(std::clamp(x0 + (i & 1), 0, width - 1), std::clamp(y0 + (i >> 1), 0, height - 1), w);
  }
}

}  // namespace

void place(const Rgba& from, const Piece& piece, Rgba& to) {
  if (piece.from_x + piece.from_side > from.width || piece.from_y + piece.from_side > from.height) return;
  for (int y = 0; y < piece.to_side; ++y)
    for (int x = 0; x < piece.to_side; ++x) {
      auto* target = to.at(piece.to_x + x, piece.to_y + y);
      Mix mix;
      if (piece.from_side == piece.to_side) {
        std::copy_n(from.at(piece.from_x + x, piece.from_y + y), 4, target);
        continue;
      }
      if (piece.from_side > piece.to_side) {
        const int step = piece.from_side / piece.to_side;
        for (int j = 0; j < step; ++j)
          for (int i = 0; i < step; ++i)
            mix.add(from.at(piece.from_x + x * step + i, piece.from_y + y * step + j), 1);
      } else {
        const double scale = static_cast<double>(piece.from_side) / piece.to_side;
        aroundPoint(from.width, from.height, piece.from_x + (x + 0.5) * scale,
                    piece.from_y + (y + 0.5) * scale,
                    [&](int sx, int sy, double w) { mix.add(from.at(sx, sy), w); });
      }
      mix.write(target);
    }
}

void place(const Heights& from, const Piece& piece, Heights& to) {
  if (piece.from_x + piece.from_side > from.width || piece.from_y + piece.from_side > from.height) return;
  for (int y = 0; y < piece.to_side; ++y)
    for (int x = 0; x < piece.to_side; ++x) {
      auto& target = to.at(piece.to_x + x, piece.to_y + y);
      if (piece.from_side == piece.to_side) {
        target = from.at(piece.from_x + x, piece.from_y + y);
      } else if (piece.from_side > piece.to_side) {
        const int step = piece.from_side / piece.to_side;
        double sum = 0;
        int count = 0;
        for (int j = 0; j < step; ++j)
          for (int i = 0; i < step; ++i) {
            const float h = from.at(piece.from_x + x * step + i, piece.from_y + y * step + j);
            if (std::isnan(h)) continue;
            sum += static_cast<double>(h);
            ++count;
          }
        if (count > 0) target = static_cast<float>(sum / count);
      } else {
        const double scale = static_cast<double>(piece.from_side) / piece.to_side;
        target = bilinear(from, piece.from_x + (x + 0.5) * scale, piece.from_y + (y + 0.5) * scale);
      }
    }
}

float bilinear(const Heights& heights, double x, double y) {
  const int nx = std::clamp(static_cast<int>(std::floor(x)), 0, heights.width - 1);
  const int ny = std::clamp(static_cast<int>(std::floor(y)), 0, heights.height - 1);
  if (std::isnan(heights.at(nx, ny))) return kNoHeight;
  double sum = 0, weight = 0;
  aroundPoint(heights.width, heights.height, x, y, [&](int sx, int sy, double w) {
    const float h = heights.at(sx, sy);
    if (std::isnan(h)) return;
    sum += w * static_cast<double>(h);
    weight += w;
  });
  return weight > 0 ? static_cast<float>(sum / weight) : heights.at(nx, ny);
}

Rgba hillshade(const Heights& bordered, double texel_m) {
  const int width = bordered.width - 2, height = bordered.height - 2;
  Rgba out(width, height);
  // unit vector to the light: azimuth 315 degrees, elevation 45 degrees; x east, y north, z up
  const double light_x = -0.5, light_y = 0.5, light_z = std::sqrt(0.5);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const float centre = bordered.at(x + 1, y + 1);
      if (std::isnan(centre)) continue;
      const auto at = [&](int dx, int dy) {
        const float h = bordered.at(x + 1 + dx, y + 1 + dy);
        return static_cast<double>(std::isnan(h) ? centre : h);
      };
      // Horn (1981): weighted central differences
      const double east =
          (at(1, -1) + 2 * at(1, 0) + at(1, 1) - at(-1, -1) - 2 * at(-1, 0) - at(-1, 1)) / (8 * texel_m);
      const double north =
          (at(-1, -1) + 2 * at(0, -1) + at(1, -1) - at(-1, 1) - 2 * at(0, 1) - at(1, 1)) / (8 * texel_m);
      const double lit =
          (-east * light_x - north * light_y + light_z) / std::sqrt(1 + east * east + north * north);
      // level ground is neutral: a light veil of white above it, of black below
      const double shade = std::clamp(lit, 0.0, 1.0) - light_z;
      auto* texel = out.at(x, y);
      const auto tone = static_cast<std::uint8_t>(shade > 0 ? 255 : 0);
      texel[0] = texel[1] = texel[2] = tone;
      texel[3] = static_cast<std::uint8_t>(
          std::clamp(std::lround(std::abs(shade) * (shade > 0 ? 500 : 300)) + 1, 1L, 230L));
    }
  return out;
}

}  // namespace overfly::link
