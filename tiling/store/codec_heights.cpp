#include "tiling/store/codec_heights.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "tiling/store/detail/compress.h"

namespace overfly::tiling {
namespace {

constexpr std::uint8_t kMagicQuantised = 'H';
constexpr std::uint8_t kMagicExact = 'E';
constexpr std::uint8_t kHasMask = 1;
constexpr int kLargestSize = 4096;
constexpr float kHole = std::numeric_limits<float>::quiet_NaN();
// A residual that two bytes do not hold is kept apart.
constexpr std::uint32_t kEscape = 0xffff;

// 16 bytes in front of the compressed planes.
struct Header {
  std::uint8_t magic;
  std::uint8_t flags;
  std::uint8_t predictor;
  std::uint8_t block;  // texels along the side of a block, 1 unless a bound
  std::uint16_t size;  // values along a side of the coded raster
  std::uint16_t reserved;
  double step_m;
};
static_assert(sizeof(Header) == 16);

constexpr std::uint32_t zigzag(std::int32_t value) {
  return static_cast<std::uint32_t>(value) << 1 ^ static_cast<std::uint32_t>(value >> 31);
}
constexpr std::int32_t unzigzag(std::uint32_t value) {
  return static_cast<std::int32_t>(value >> 1 ^ (0U - (value & 1)));
}

// Prediction of a value from its neighbours west, north and north-west, in arithmetic modulo 2^32; `row` is
// the values' row, `above` the one to the north (null in the first).
std::int32_t predict(HeightPredictor kind, const std::int32_t* row, const std::int32_t* above, int column) {
  if (column == 0) return above == nullptr ? 0 : above[0];
  const std::int32_t west = row[column - 1];
  if (above == nullptr || kind == HeightPredictor::Left) return west;
  const std::int32_t north = above[column], corner = above[column - 1];
  const auto plane =
      static_cast<std::int32_t>(static_cast<std::uint32_t>(west) + static_cast<std::uint32_t>(north) -
                                static_cast<std::uint32_t>(corner));
  if (kind == HeightPredictor::Plane) return plane;
  // The same as the median of the three, and free of overflow.
  if (corner >= std::max(west, north)) return std::min(west, north);
  if (corner <= std::min(west, north)) return std::max(west, north);
  return plane;
}

std::int32_t difference(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) - static_cast<std::uint32_t>(b));
}
std::int32_t sum(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b));
}

// To the nearest integer, ties to even, for |value| < 2^51: what nearbyint does, without the call.
double rounded(double value) {
  constexpr double kShift = 0x1.8p52;
  return (value + kShift) - kShift;
}

struct Quantised {
  std::vector<std::int32_t> values;
  std::vector<std::uint8_t> valid;  // 1: has data
  bool has_hole = false;
};

enum class Rounding { Nearest, Up };

Result<Quantised> quantise(std::span<const float> heights, double step, Rounding rounding) {
  Quantised quantised;
  quantised.values.resize(heights.size());
  quantised.valid.resize(heights.size());
  for (std::size_t i = 0; i < heights.size(); ++i) {
    const float height = heights[i];
    if (!std::isfinite(height)) {
      quantised.has_hole = true;
      continue;
    }
    double steps = rounding == Rounding::Up ? std::ceil(height / step) : rounded(height / step);
    if (rounding == Rounding::Up)
      while (static_cast<float>(steps * step) < height) ++steps;
    if (!(std::abs(steps) < 2147483647.0))
      return fail(ErrorCode::BadInput, fmt::format("a height of {} m is out of range", height));
    quantised.values[i] = static_cast<std::int32_t>(steps);
    quantised.valid[i] = 1;
  }
  return quantised;
}

Result<std::vector<std::uint8_t>> pack(Quantised& raster, int size, int block, const HeightCoding& coding) {
  const std::size_t count = raster.values.size();
  const std::size_t mask_bytes = raster.has_hole ? (count + 7) / 8 : 0;
  std::vector<std::uint8_t> planes(mask_bytes + 2 * count);
  std::uint8_t* const low = planes.data() + mask_bytes;
  std::uint8_t* const high = low + count;
  std::vector<std::uint32_t> escapes;
  std::size_t i = 0;
  for (int y = 0; y < size; ++y) {
    std::int32_t* const row =
        raster.values.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(size);
    const std::int32_t* const above = y == 0 ? nullptr : row - size;
    for (int x = 0; x < size; ++x, ++i) {
      const std::int32_t predicted = predict(coding.predictor, row, above, x);
      if (raster.valid[i] == 0) {
        row[x] = predicted;  // a hole is as smooth as can be
        continue;
      }
      if (mask_bytes != 0) planes[i / 8] |= static_cast<std::uint8_t>(1U << (i % 8));
      const std::uint32_t residual = zigzag(difference(row[x], predicted));
      const std::uint32_t shortened = std::min(residual, kEscape);
      if (shortened == kEscape) escapes.push_back(residual);
      low[i] = static_cast<std::uint8_t>(shortened);
      high[i] = static_cast<std::uint8_t>(shortened >> 8);
    }
  }
  const std::size_t plain = planes.size();
  planes.resize(plain + escapes.size() * sizeof(std::uint32_t));
  if (!escapes.empty())
    std::memcpy(planes.data() + plain, escapes.data(), escapes.size() * sizeof(std::uint32_t));

  const Header header{kMagicQuantised,
                      raster.has_hole ? kHasMask : std::uint8_t{0},
                      static_cast<std::uint8_t>(coding.predictor),
                      static_cast<std::uint8_t>(block),
                      static_cast<std::uint16_t>(size),
                      0,
                      coding.step_m};
  std::vector<std::uint8_t> bytes(sizeof header);
  std::memcpy(bytes.data(), &header, sizeof header);
  if (const Result<void> done = detail::compress(planes, coding.zstd_level, bytes); !done)
    return tl::unexpected(done.error());
  return bytes;
}

tl::unexpected<Error> damaged() { return fail(ErrorCode::Corrupt, "the coded heights are damaged"); }

struct Unpacked {
  Header header;
  std::vector<float> values;
};

Result<Unpacked> unpack(std::span<const std::uint8_t> bytes) {
  Unpacked result{};
  Header& header = result.header;
  if (bytes.size() < sizeof header) return damaged();
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.magic != kMagicQuantised || header.predictor > 2 || header.size == 0 ||
      header.size > kLargestSize || header.block == 0 || !(header.step_m > 0) ||
      !std::isfinite(header.step_m))
    return damaged();
  const int size = header.size;
  const std::size_t count = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  const std::size_t mask_bytes = (header.flags & kHasMask) != 0 ? (count + 7) / 8 : 0;
  const Result<std::vector<std::uint8_t>> planes =
      detail::decompress(bytes.subspan(sizeof header), mask_bytes + count * (2 + sizeof(std::uint32_t)));
  if (!planes) return tl::unexpected(planes.error());
  if (planes->size() < mask_bytes + 2 * count) return damaged();
  const std::uint8_t* const low = planes->data() + mask_bytes;
  const std::uint8_t* const high = low + count;
  std::size_t escape = mask_bytes + 2 * count;
  const auto kind = static_cast<HeightPredictor>(header.predictor);
  std::vector<std::int32_t> steps(count);
  result.values.resize(count);
  std::size_t i = 0;
  for (int y = 0; y < size; ++y) {
    std::int32_t* const row = steps.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(size);
    const std::int32_t* const above = y == 0 ? nullptr : row - size;
    for (int x = 0; x < size; ++x, ++i) {
      std::uint32_t residual = low[i] | static_cast<std::uint32_t>(high[i]) << 8;
      if (residual == kEscape) {
        if (escape + sizeof residual > planes->size()) return damaged();
        std::memcpy(&residual, planes->data() + escape, sizeof residual);
        escape += sizeof residual;
      }
      row[x] = sum(predict(kind, row, above, x), unzigzag(residual));
      const bool valid = mask_bytes == 0 || ((*planes)[i / 8] >> (i % 8) & 1) != 0;
      result.values[i] = valid ? static_cast<float>(row[x] * header.step_m) : kHole;
    }
  }
  if (escape != planes->size()) return damaged();
  return result;
}

Result<void> checkRaster(std::size_t values, int size) {
  if (size < 1 || size > kLargestSize ||
      values != static_cast<std::size_t>(size) * static_cast<std::size_t>(size))
    return fail(ErrorCode::BadInput, fmt::format("{} heights are no raster of side {}", values, size));
  return {};
}

Result<void> checkStep(double step) {
  if (!(step > 0) || !std::isfinite(step))
    return fail(ErrorCode::BadInput, fmt::format("an elevation step of {} m is not possible", step));
  return {};
}

}  // namespace

Result<std::vector<std::uint8_t>> encodeHeights(std::span<const float> heights, int size,
                                                const HeightCoding& coding) {
  if (const Result<void> fine = checkRaster(heights.size(), size); !fine) return tl::unexpected(fine.error());
  if (const Result<void> fine = checkStep(coding.step_m); !fine) return tl::unexpected(fine.error());
  Result<Quantised> quantised = quantise(heights, coding.step_m, Rounding::Nearest);
  if (!quantised) return tl::unexpected(quantised.error());
  return pack(*quantised, size, 1, coding);
}

Result<std::vector<float>> decodeHeights(std::span<const std::uint8_t> bytes, int size) {
  Result<Unpacked> raster = unpack(bytes);
  if (!raster) return tl::unexpected(raster.error());
  if (raster->header.size != size || raster->header.block != 1) return damaged();
  return std::move(raster->values);
}

float quantisedHeight(float height_m, double step_m) {
  if (!std::isfinite(height_m)) return kHole;
  return static_cast<float>(rounded(height_m / step_m) * step_m);
}

Result<std::vector<std::uint8_t>> encodeBound(std::span<const float> bound, int size, int block,
                                              const HeightCoding& coding) {
  if (const Result<void> fine = checkRaster(bound.size(), size); !fine) return tl::unexpected(fine.error());
  if (const Result<void> fine = checkStep(coding.step_m); !fine) return tl::unexpected(fine.error());
  if (block < 1 || block > 128 || std::popcount(static_cast<unsigned>(block)) != 1 || size % block != 0)
    return fail(ErrorCode::BadInput,
                fmt::format("blocks of {} texels do not divide a side of {}", block, size));
  const int side = size / block;
  std::vector<float> highest(static_cast<std::size_t>(side) * static_cast<std::size_t>(side), kHole);
  std::size_t i = 0;
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x, ++i) {
      if (!std::isfinite(bound[i])) continue;
      float& most = highest[static_cast<std::size_t>(y / block) * static_cast<std::size_t>(side) +
                            static_cast<std::size_t>(x / block)];
      if (!(most >= bound[i])) most = bound[i];
    }
  Result<Quantised> quantised = quantise(highest, coding.step_m, Rounding::Up);
  if (!quantised) return tl::unexpected(quantised.error());
  return pack(*quantised, side, block, coding);
}

Result<std::vector<float>> decodeBound(std::span<const std::uint8_t> bytes, int size) {
  const Result<Unpacked> raster = unpack(bytes);
  if (!raster) return tl::unexpected(raster.error());
  const int block = raster->header.block, side = raster->header.size;
  if (side * block != size) return damaged();
  std::vector<float> bound(static_cast<std::size_t>(size) * static_cast<std::size_t>(size));
  std::size_t i = 0;
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x)
      bound[i++] = raster->values[static_cast<std::size_t>(y / block) * static_cast<std::size_t>(side) +
                                  static_cast<std::size_t>(x / block)];
  return bound;
}

Result<std::vector<std::uint8_t>> encodeExactHeights(std::span<const float> heights, int size,
                                                     int zstd_level) {
  if (const Result<void> fine = checkRaster(heights.size(), size); !fine) return tl::unexpected(fine.error());
  const std::size_t count = heights.size();
  std::vector<std::uint8_t> planes(4 * count);
  std::uint32_t west = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto bits = std::bit_cast<std::uint32_t>(heights[i]);
    const std::uint32_t residual = zigzag(static_cast<std::int32_t>(bits - west));
    west = bits;
    for (std::size_t plane = 0; plane < 4; ++plane)
      planes[plane * count + i] = static_cast<std::uint8_t>(residual >> (8 * plane));
  }
  const Header header{kMagicExact, 0, 0, 1, static_cast<std::uint16_t>(size), 0, 0};
  std::vector<std::uint8_t> bytes(sizeof header);
  std::memcpy(bytes.data(), &header, sizeof header);
  if (const Result<void> done = detail::compress(planes, zstd_level, bytes); !done)
    return tl::unexpected(done.error());
  return bytes;
}

Result<std::vector<float>> decodeExactHeights(std::span<const std::uint8_t> bytes, int size) {
  Header header{};
  if (bytes.size() < sizeof header) return damaged();
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.magic != kMagicExact || header.size != size || size < 1 || size > kLargestSize) return damaged();
  const std::size_t count = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  const Result<std::vector<std::uint8_t>> planes =
      detail::decompress(bytes.subspan(sizeof header), 4 * count);
  if (!planes) return tl::unexpected(planes.error());
  if (planes->size() != 4 * count) return damaged();
  std::vector<float> heights(count);
  std::uint32_t west = 0;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint32_t residual = 0;
    for (std::size_t plane = 0; plane < 4; ++plane)
      residual |= static_cast<std::uint32_t>((*planes)[plane * count + i]) << (8 * plane);
    west += static_cast<std::uint32_t>(unzigzag(residual));
    heights[i] = std::bit_cast<float>(west);
  }
  return heights;
}

}  // namespace overfly::tiling
