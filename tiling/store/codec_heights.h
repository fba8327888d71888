#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "config/error.h"

namespace overfly::tiling {

// Rasters of heights as compact bytes: quantised to a step, the residual of a two-dimensional predictor in
// byte planes, zstd. NaN is no data and survives; so does every texel with data. Reentrant. The layout of
// the bytes and the comparison with lossless WebP and LERC are in docs/tile-store.md.

enum class HeightPredictor : std::uint8_t {
  Left = 0,    // the texel to the west
  Plane = 1,   // west + north - north-west
  Median = 2,  // the median of west, north and Plane (LOCO-I, Weinberger et al. 2000, eq. 1)
};

struct HeightCoding {
  double step_m = 0.01;  // quantum; a decoded height is off by at most half of it, plus a float's rounding
  int zstd_level = 1;  // measured (docs/tile-store.md): 3 and 9 gain nothing, 19 a ninth at 40 times the time
  HeightPredictor predictor = HeightPredictor::Median;
};

// `heights` has size * size values. Decoding gives the same values wherever it runs; coding what was decoded
// gives the same bytes. BadInput: a height that 2^31 steps do not reach. Infinite heights count as no data.
[[nodiscard]] Result<std::vector<std::uint8_t>> encodeHeights(std::span<const float> heights, int size,
                                                              const HeightCoding& coding);
[[nodiscard]] Result<std::vector<float>> decodeHeights(std::span<const std::uint8_t> bytes, int size);

// What a height becomes by coding and decoding; NaN stays NaN.
[[nodiscard]] float quantisedHeight(float height_m, double step_m);

// An upper bound of a raster: the maximum over blocks of `block` x `block` texels (a power of two), rounded
// up to the step. What is decoded, size * size again, is nowhere below `bound`; NaN only where a whole block
// has no data.
[[nodiscard]] Result<std::vector<std::uint8_t>> encodeBound(std::span<const float> bound, int size, int block,
                                                            const HeightCoding& coding);
[[nodiscard]] Result<std::vector<float>> decodeBound(std::span<const std::uint8_t> bytes, int size);

// Bit for bit, NaN's payload included; about 2 bytes a texel for measured heights.
[[nodiscard]] Result<std::vector<std::uint8_t>> encodeExactHeights(std::span<const float> heights, int size,
                                                                   int zstd_level = 1);
[[nodiscard]] Result<std::vector<float>> decodeExactHeights(std::span<const std::uint8_t> bytes, int size);

}  // namespace overfly::tiling
