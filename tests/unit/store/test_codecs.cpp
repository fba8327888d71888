#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "tiling/store/codec_color.h"
#include "tiling/store/codec_heights.h"
#include "tiling/store/codec_planes.h"

namespace overfly::tiling {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// A raster of side 16 with slopes, steps, noise and holes of random share.
std::vector<float> randomHeights(int size) {
  const auto hole_percent = *rc::gen::element(0, 0, 3, 50, 97, 100);
  const auto base = static_cast<float>(*rc::gen::inRange(-500, 9000));
  const auto noise = static_cast<float>(*rc::gen::element(0, 1, 30, 5000)) * 0.01F;
  const auto slope = static_cast<float>(*rc::gen::inRange(-100, 100)) * 0.01F;
  std::vector<float> heights;
  for (int i = 0; i < size * size; ++i) {
    const auto dice = *rc::gen::resize(1000, rc::gen::inRange(0, 100));
    const auto wiggle = static_cast<float>(*rc::gen::inRange(-1000, 1000)) * 0.001F;
    heights.push_back(dice < hole_percent ? kNan
                                          : base + slope * static_cast<float>(i % size) + noise * wiggle);
  }
  return heights;
}

RC_GTEST_PROP(HeightCodec, HolesSurviveAndHeightsStayWithinHalfAStep, ()) {
  constexpr int kSize = 16;
  const std::vector<float> heights = randomHeights(kSize);
  HeightCoding coding;
  coding.step_m = *rc::gen::element(0.001, 0.01, 0.05, 1.0);
  coding.predictor =
      *rc::gen::element(HeightPredictor::Left, HeightPredictor::Plane, HeightPredictor::Median);
  const auto bytes = encodeHeights(heights, kSize, coding);
  RC_ASSERT(bytes.has_value());
  const auto back = decodeHeights(*bytes, kSize);
  RC_ASSERT(back.has_value());
  for (std::size_t i = 0; i < heights.size(); ++i) {
    RC_ASSERT(std::isnan(heights[i]) == std::isnan((*back)[i]));
    if (std::isnan(heights[i])) continue;
    const double rounding = std::abs(heights[i]) * 1.2e-7;  // of the float that is handed out
    RC_ASSERT(std::abs(double{heights[i]} - (*back)[i]) <= coding.step_m / 2 + rounding);
    RC_ASSERT((*back)[i] == quantisedHeight(heights[i], coding.step_m));
  }
  RC_ASSERT(encodeHeights(*back, kSize, coding).value() == *bytes);
}

RC_GTEST_PROP(HeightCodec, ABoundIsNeverBelow, ()) {
  constexpr int kSize = 16;
  const std::vector<float> heights = randomHeights(kSize);
  HeightCoding coding;
  coding.step_m = *rc::gen::element(0.001, 0.1, 0.3, 10.0);
  const int block = *rc::gen::element(1, 2, 4, 16);
  const auto bytes = encodeBound(heights, kSize, block, coding);
  RC_ASSERT(bytes.has_value());
  const auto back = decodeBound(*bytes, kSize);
  RC_ASSERT(back.has_value());
  for (std::size_t i = 0; i < heights.size(); ++i)
    if (!std::isnan(heights[i])) {
      RC_ASSERT((*back)[i] >= heights[i]);
    }
  if (block == 1)
    for (std::size_t i = 0; i < heights.size(); ++i) {
      RC_ASSERT(std::isnan(heights[i]) == std::isnan((*back)[i]));
      if (!std::isnan(heights[i])) {
        RC_ASSERT((*back)[i] <= heights[i] + coding.step_m * 1.01 + 1e-3);
      }
    }
}

RC_GTEST_PROP(HeightCodec, ExactHeightsKeepEveryBit, (std::vector<std::uint32_t> bits)) {
  constexpr int kSize = 8;
  bits.resize(kSize * kSize, 0x7fc01234);  // a NaN with a payload
  std::vector<float> heights;
  for (const std::uint32_t value : bits) heights.push_back(std::bit_cast<float>(value));
  const auto back = decodeExactHeights(encodeExactHeights(heights, kSize).value(), kSize);
  RC_ASSERT(back.has_value());
  for (std::size_t i = 0; i < heights.size(); ++i)
    RC_ASSERT(std::bit_cast<std::uint32_t>((*back)[i]) == bits[i]);
}

TEST(HeightCodec, StepsAcrossTheWholeRangeAreKept) {
  const std::vector<float> heights{-500, 9000, kNan, 9000, -500, -500, 8848.86F, 0, 1e7F};
  const auto back = decodeHeights(encodeHeights(heights, 3, {}).value(), 3).value();
  for (std::size_t i = 0; i < heights.size(); ++i)
    if (!std::isnan(heights[i])) {
      EXPECT_NEAR(back[i], heights[i], 0.006);
    }
}

TEST(HeightCodec, WhatCannotBeCodedIsRefused) {
  const std::vector<float> high{1e9F};
  EXPECT_EQ(encodeHeights(high, 1, {}).error().code, ErrorCode::BadInput);
  EXPECT_EQ(encodeHeights(high, 2, {}).error().code, ErrorCode::BadInput);
  EXPECT_EQ(encodeHeights(high, 1, {.step_m = 0}).error().code, ErrorCode::BadInput);
  const std::vector<float> infinite{std::numeric_limits<float>::infinity()};
  EXPECT_TRUE(std::isnan(decodeHeights(encodeHeights(infinite, 1, {}).value(), 1).value()[0]));
}

// No crash and no read beyond the bytes (the sanitizer presets watch), whatever they are.
RC_GTEST_PROP(Codecs, DamagedBytesAreAnErrorOrARaster, ()) {
  constexpr int kSize = 16;
  const std::vector<float> heights = randomHeights(kSize);
  const std::vector<std::uint8_t> plane(kSize * kSize, 3);
  const std::vector<std::span<const std::uint8_t>> planes{plane, plane};
  std::vector<std::uint8_t> rgba(4 * kSize * kSize, 200);
  std::vector<std::vector<std::uint8_t>> all{
      encodeHeights(heights, kSize, {}).value(), encodeExactHeights(heights, kSize).value(),
      encodePlanes(planes, kSize).value(), encodeColor(rgba, kSize, {}).value().bytes};
  rgba[3] = 0;
  all.push_back(encodeColor(rgba, kSize, {}).value().bytes);
  for (std::vector<std::uint8_t>& bytes : all) {
    for (int i = *rc::gen::inRange(0, 4); i > 0; --i)
      bytes[*rc::gen::inRange<std::size_t>(0, bytes.size())] = *rc::gen::arbitrary<std::uint8_t>();
    if (*rc::gen::arbitrary<bool>()) bytes.resize(*rc::gen::inRange<std::size_t>(0, bytes.size()));
    (void)decodeHeights(bytes, kSize);
    (void)decodeBound(bytes, kSize);
    (void)decodeExactHeights(bytes, kSize);
    (void)decodePlanes(bytes, kSize);
    (void)decodeColor(Codec::Jpeg, bytes, kSize);
    (void)decodeColor(Codec::Webp, bytes, kSize);
  }
}

RC_GTEST_PROP(ColorCodec, AlphaSurvivesExactlyAndHolesAreBlack, ()) {
  constexpr int kSize = 16;
  std::vector<std::uint8_t> rgba(4 * kSize * kSize);
  const bool opaque = *rc::gen::arbitrary<bool>();
  const auto format = *rc::gen::element(ColorFormat::Auto, ColorFormat::Webp);
  for (std::size_t i = 0; i < rgba.size(); i += 4) {
    for (std::size_t c = 0; c < 3; ++c) rgba[i + c] = *rc::gen::arbitrary<std::uint8_t>();
    rgba[i + 3] = opaque ? 255 : *rc::gen::element<std::uint8_t>(0, 0, 255, 255, 77);
  }
  const auto coded = encodeColor(rgba, kSize, {.format = format, .quality = *rc::gen::inRange(1, 101)});
  RC_ASSERT(coded.has_value());
  RC_ASSERT(coded->codec == (opaque && format == ColorFormat::Auto ? Codec::Jpeg : Codec::Webp));
  const auto back = decodeColor(coded->codec, coded->bytes, kSize);
  RC_ASSERT(back.has_value());
  for (std::size_t i = 0; i < rgba.size(); i += 4) {
    RC_ASSERT((*back)[i + 3] == rgba[i + 3]);
    if (rgba[i + 3] == 0) {
      RC_ASSERT(((*back)[i] | (*back)[i + 1] | (*back)[i + 2]) == 0);
    }
  }
}

TEST(ColorCodec, ColoursComeBackNearly) {
  constexpr int kSize = 64;
  std::vector<std::uint8_t> rgba;
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      for (const int value : {2 * x + 60, 2 * y + 60, 120, (x + y) % 64 == 0 ? 0 : 255})
        rgba.push_back(static_cast<std::uint8_t>(value));
  for (const bool opaque : {true, false}) {
    if (opaque)
      for (std::size_t i = 3; i < rgba.size(); i += 4) rgba[i] = 255;
    const auto coded = encodeColor(rgba, kSize, {.quality = 95}).value();
    const auto back = decodeColor(coded.codec, coded.bytes, kSize).value();
    double error = 0;
    for (std::size_t i = 0; i < rgba.size(); ++i)
      if (rgba[i | 3] != 0) error += std::abs(int{rgba[i]} - int{back[i]});
    EXPECT_LT(error / static_cast<double>(rgba.size()), 2.0) << "opaque " << opaque;
  }
}

RC_GTEST_PROP(PlaneCodec, PlanesComeBack, ()) {
  constexpr int kSize = 8;
  std::vector<std::vector<std::uint8_t>> planes(*rc::gen::inRange<std::size_t>(0, 7));
  for (auto& plane : planes)
    plane = *rc::gen::container<std::vector<std::uint8_t>>(kSize * kSize, rc::gen::arbitrary<std::uint8_t>());
  const std::vector<std::span<const std::uint8_t>> spans(planes.begin(), planes.end());
  RC_ASSERT(decodePlanes(encodePlanes(spans, kSize).value(), kSize).value() == planes);
}

}  // namespace
}  // namespace overfly::tiling
