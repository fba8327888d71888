#include "daemon/tradeoff/codec_trials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tiling/store/codec_color.h"
#include "tiling/store/codec_heights.h"

namespace overfly::tradeoff {
namespace {

// Enough tiles for a mean; more would only take longer.
constexpr std::size_t kMostTiles = 24;

}  // namespace

double psnr(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  double squares = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i + 3 < a.size() && i + 3 < b.size(); i += 4) {
    if (a[i + 3] != 255 || b[i + 3] != 255) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d = static_cast<double>(a[i + c]) - static_cast<double>(b[i + c]);
      squares += d * d;
    }
    count += 3;
  }
  if (squares == 0) return std::numeric_limits<double>::infinity();
  return 10 * std::log10(255.0 * 255.0 * static_cast<double>(count) / squares);
}

double ssim(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b, int size) {
  constexpr int kWindow = 8, kStride = 4;
  constexpr double kC1 = (0.01 * 255) * (0.01 * 255), kC2 = (0.03 * 255) * (0.03 * 255);
  double sum = 0;
  std::size_t windows = 0;
  const auto luma = [](const std::vector<std::uint8_t>& p, std::size_t i) {
    return 0.299 * p[i] + 0.587 * p[i + 1] + 0.114 * p[i + 2];
  };
  for (int y = 0; y + kWindow <= size; y += kStride)
    for (int x = 0; x + kWindow <= size; x += kStride) {
      double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
      bool opaque = true;
      for (int v = y; v < y + kWindow && opaque; ++v)
        for (int u = x; u < x + kWindow; ++u) {
          const auto i = 4 * (static_cast<std::size_t>(v) * static_cast<std::size_t>(size) +
                              static_cast<std::size_t>(u));
          if (a[i + 3] != 255 || b[i + 3] != 255) {
            opaque = false;
            break;
          }
          const double la = luma(a, i), lb = luma(b, i);
          sa += la, sb += lb, saa += la * la, sbb += lb * lb, sab += la * lb;
        }
      if (!opaque) continue;
      constexpr double n = kWindow * kWindow;
      const double ma = sa / n, mb = sb / n;
      const double va = saa / n - ma * ma, vb = sbb / n - mb * mb, cov = sab / n - ma * mb;
      sum += (2 * ma * mb + kC1) * (2 * cov + kC2) / ((ma * ma + mb * mb + kC1) * (va + vb + kC2));
      ++windows;
    }
  return windows == 0 ? 1.0 : sum / static_cast<double>(windows);
}

Result<std::vector<Trial>> tryCodecs(const std::map<geo::TileKey, tiling::Tile>& tiles, int repeats) {
  std::vector<const tiling::Tile*> chosen;
  const std::size_t step = std::max<std::size_t>(1, tiles.size() / kMostTiles);
  std::size_t at = 0;
  for (const auto& [key, tile] : tiles)
    if (at++ % step == 0 && chosen.size() < kMostTiles) chosen.push_back(&tile);
  if (chosen.empty()) return fail(ErrorCode::BadInput, "no tile to code");
  const auto count = static_cast<double>(chosen.size());
  std::vector<Trial> trials;

  // Codes all tiles, `repeats` times; `tile` gives bytes and notes errors on the last run.
  const auto measure =
      [&](Trial& trial,
          const std::function<Result<std::size_t>(const tiling::Tile&)>& code) -> Result<double> {
    std::vector<double> processor, wall;
    double bytes = 0;
    for (int run = 0; run <= repeats; ++run) {
      Result<void> failed{};
      bytes = 0;
      const Elapsed elapsed = elapsedOf([&] {
        for (const tiling::Tile* tile : chosen) {
          auto coded = code(*tile);
          if (!coded) {
            failed = tl::unexpected(coded.error());
            return;
          }
          bytes += static_cast<double>(*coded);
        }
      });
      if (!failed) return tl::unexpected(failed.error());
      if (run == 0) continue;  // to warm up
      processor.push_back(elapsed.processor_ms / count);
      wall.push_back(elapsed.wall_ms / count);
    }
    trial.processor = timingOf(processor);
    trial.wall = timingOf(wall);
    return bytes / count;
  };

  const tiling::ColorCoding standard;
  for (const auto format : {tiling::ColorFormat::Auto, tiling::ColorFormat::Webp})
    for (const int quality : {50, 70, 80, 85, 90, 95}) {
      const tiling::ColorCoding coding{format, quality, standard.webp_method};
      Trial trial{
          .part = "colour",
          .axis = format == tiling::ColorFormat::Auto ? "JPEG (WebP at the rim)" : "WebP",
          .setting = fmt::format("{} {}", format == tiling::ColorFormat::Auto ? "JPEG" : "WebP", quality),
          .is_default = format == standard.format && quality == standard.quality};
      double squares = 0, similarity = 0;
      auto bytes = measure(trial, [&](const tiling::Tile& tile) -> Result<std::size_t> {
        auto coded = tiling::encodeColor(tile.color, tile.size, coding);
        if (!coded) return tl::unexpected(coded.error());
        auto decoded = tiling::decodeColor(coded->codec, coded->bytes, tile.size);
        if (!decoded) return tl::unexpected(decoded.error());
        return coded->bytes.size();
      });
      if (!bytes) return tl::unexpected(bytes.error());
      for (const tiling::Tile* tile : chosen) {
        auto coded = tiling::encodeColor(tile->color, tile->size, coding);
        if (!coded) return tl::unexpected(coded.error());
        auto decoded = tiling::decodeColor(coded->codec, coded->bytes, tile->size);
        if (!decoded) return tl::unexpected(decoded.error());
        squares += std::pow(10.0, -psnr(tile->color, *decoded) / 10);
        similarity += ssim(tile->color, *decoded, tile->size);
      }
      trial.error_name = "1 - SSIM";
      trial.error = 1 - similarity / count;
      trial.figures = {
          {"bytes", *bytes}, {"psnr_db", -10 * std::log10(squares / count)}, {"ssim", similarity / count}};
      trials.push_back(std::move(trial));
    }

  const tiling::HeightCoding standard_heights;
  for (const double step_m : {0.001, 0.005, 0.01, 0.02, 0.05, 0.1})
    for (const int level : {1, 9}) {
      tiling::HeightCoding coding;
      coding.step_m = step_m;
      coding.zstd_level = level;
      Trial trial{.part = "heights",
                  .axis = fmt::format("zstd {}", level),
                  .setting = fmt::format("step {:g} mm, zstd {}", 1000 * step_m, level),
                  .is_default = step_m == standard_heights.step_m && level == standard_heights.zstd_level};
      auto bytes = measure(trial, [&](const tiling::Tile& tile) -> Result<std::size_t> {
        auto coded = tiling::encodeHeights(tile.elevation, tile.size, coding);
        if (!coded) return tl::unexpected(coded.error());
        auto decoded = tiling::decodeHeights(*coded, tile.size);
        if (!decoded) return tl::unexpected(decoded.error());
        return coded->size();
      });
      if (!bytes) return tl::unexpected(bytes.error());
      double squares = 0, worst = 0;
      std::size_t texels = 0;
      for (const tiling::Tile* tile : chosen) {
        auto coded = tiling::encodeHeights(tile->elevation, tile->size, coding);
        if (!coded) return tl::unexpected(coded.error());
        auto decoded = tiling::decodeHeights(*coded, tile->size);
        if (!decoded) return tl::unexpected(decoded.error());
        for (std::size_t i = 0; i < decoded->size(); ++i) {
          if (std::isnan(tile->elevation[i])) continue;
          const double d = static_cast<double>((*decoded)[i]) - static_cast<double>(tile->elevation[i]);
          squares += d * d;
          worst = std::max(worst, std::abs(d));
          ++texels;
        }
      }
      trial.error_name = "RMSE, mm";
      trial.error = 1000 * std::sqrt(squares / static_cast<double>(std::max<std::size_t>(texels, 1)));
      trial.figures = {{"bytes", *bytes}, {"worst_mm", 1000 * worst}};
      trials.push_back(std::move(trial));
    }
  return trials;
}

}  // namespace overfly::tradeoff
