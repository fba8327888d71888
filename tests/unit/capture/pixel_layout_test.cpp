#include "capture/pixel_layout.h"

#include <gtest/gtest.h>
#include <linux/videodev2.h>

#include <array>
#include <cmath>

#include "capture/image_decode.h"

namespace overfly::capture {
namespace {

using Bytes = std::vector<std::uint8_t>;

PixelLayout layout(std::uint32_t fourcc) {
  const auto found = layoutOf(fourcc);
  EXPECT_TRUE(found);
  return found.value_or(PixelLayout{});
}

TEST(PixelLayout, GreyLosesThePaddingOfItsRows) {
  const Bytes buffer{1, 2, 3, 0, 4, 5, 6};  // the last row may end without padding
  const auto image = takeImage(buffer, layout(V4L2_PIX_FMT_GREY), 3, 2, 4, false);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->bytes, (Bytes{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(problemOf(*image), std::nullopt);
}

TEST(PixelLayout, YuyvBecomesNv12WithTheChromaOfBothRows) {
  const Bytes buffer{10, 100, 20, 200, 30, 110, 40, 210};
  const auto image = takeImage(buffer, layout(V4L2_PIX_FMT_YUYV), 2, 2, 4, false);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->format, PixelFormat::Nv12);
  EXPECT_EQ(image->bytes, (Bytes{10, 20, 30, 40, 105, 205}));
}

TEST(PixelLayout, LimitedRangeReachesBlackAndWhite) {
  const Bytes buffer{16, 235, 0, 255, 128, 128};
  const auto image = takeImage(buffer, layout(V4L2_PIX_FMT_NV12), 2, 2, 2, true);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->bytes, (Bytes{0, 255, 0, 255, 128, 128}));
  for (int value = 0; value < 256; ++value) {
    const auto one = static_cast<std::uint8_t>(value);
    const auto stretched =
        takeImage(Bytes{one, one, one, one, one, one}, layout(V4L2_PIX_FMT_NV12), 2, 2, 2, true);
    ASSERT_TRUE(stretched);
    EXPECT_NEAR(stretched->bytes[0], std::clamp((value - 16) * 255.0 / 219, 0.0, 255.0), 0.51);
    EXPECT_NEAR(stretched->bytes[4], std::clamp((value - 128) * 255.0 / 224 + 128, 0.0, 255.0), 0.51);
  }
}

TEST(PixelLayout, OddSizesOfNv12AndYuyvAreWhole) {
  for (const std::uint32_t fourcc : {V4L2_PIX_FMT_NV12, V4L2_PIX_FMT_YUYV}) {
    const auto image =
        takeImage(Bytes(200, 77), layout(fourcc), 5, 3, fourcc == V4L2_PIX_FMT_NV12 ? 6 : 12, false);
    ASSERT_TRUE(image);
    EXPECT_EQ(problemOf(*image), std::nullopt);
    const auto colours = decodeImage(*image, PixelFormat::Rgb8);
    ASSERT_TRUE(colours);
    EXPECT_EQ(colours->width, 5);
  }
}

// A picture whose colours change linearly comes out of its mosaic exactly, borders apart: every missing
// colour is the mean of neighbours that lie around it.
TEST(PixelLayout, AMosaicOfASlopeIsTheSlope) {
  constexpr int kSize = 16;
  const auto colourAt = [](int x, int y) {
    return std::array<int, 3>{40 + 4 * x + 2 * y, 60 + 2 * x + 4 * y, 200 - 4 * x - 2 * y};
  };
  for (const PixelLayout& mosaic : knownLayouts()) {
    if (mosaic.bayer_bits == 0) continue;
    Bytes buffer;
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) {
        const bool red_row = y % 2 == mosaic.red_y, red_column = x % 2 == mosaic.red_x;
        const int channel = red_row == red_column ? (red_row ? 0 : 2) : 1;
        const int value = colourAt(x, y)[static_cast<std::size_t>(channel)];
        if (mosaic.bayer_bits == 8) {
          buffer.push_back(static_cast<std::uint8_t>(value));
        } else {
          buffer.push_back(static_cast<std::uint8_t>((value << 2) & 255));
          buffer.push_back(static_cast<std::uint8_t>(value >> 6));
        }
      }
    }
    const auto image =
        takeImage(buffer, mosaic, kSize, kSize, mosaic.bayer_bits == 8 ? kSize : 2 * kSize, false);
    ASSERT_TRUE(image);
    for (int y = 1; y + 1 < kSize; ++y)
      for (int x = 1; x + 1 < kSize; ++x)
        for (int c = 0; c < 3; ++c)
          EXPECT_EQ(image->bytes[static_cast<std::size_t>(3 * (y * kSize + x) + c)],
                    colourAt(x, y)[static_cast<std::size_t>(c)])
              << "fourcc " << mosaic.fourcc << " at " << x << "," << y << " channel " << c;
  }
}

TEST(PixelLayout, ShortBuffersAndWrongStridesAreRefused) {
  for (const PixelLayout& known : knownLayouts()) {
    if (known.becomes == PixelFormat::Jpeg) continue;
    for (const std::size_t bytes : {0u, 1u, 7u, 100u})
      EXPECT_FALSE(takeImage(Bytes(bytes), known, 64, 48, 64, false)) << known.fourcc;
    EXPECT_FALSE(takeImage(Bytes(100'000), known, 64, 48, 63, false)) << known.fourcc;
    EXPECT_FALSE(takeImage(Bytes(100'000), known, 0, 48, 200, false)) << known.fourcc;
    EXPECT_FALSE(takeImage(Bytes(100'000), known, 64, -1, 200, false)) << known.fourcc;
  }
  EXPECT_FALSE(takeImage(Bytes(100, 3), layout(V4L2_PIX_FMT_MJPEG), 64, 48, 0, false)) << "no JPEG";
}

}  // namespace
}  // namespace overfly::capture
