#include "capture/image_decode.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace overfly::capture {
namespace {

// A smooth colour pattern, so that JPEG and averaging change it little.
Image pattern(PixelFormat format, int width, int height, int padding = 0) {
  Image image;
  image.format = format;
  image.width = width;
  image.height = height;
  const int channels = format == PixelFormat::Grey8 ? 1 : 3;
  image.stride = width * channels + padding;
  image.bytes.assign(static_cast<std::size_t>(image.stride * height), 255);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int rgb[3] = {40 + 150 * x / width, 60 + 120 * y / height, 120};
      for (int c = 0; c < channels; ++c) {
        const int from = format == PixelFormat::Bgr8 ? 2 - c : c;
        image.bytes[static_cast<std::size_t>(y * image.stride + x * channels + c)] =
            static_cast<std::uint8_t>(rgb[from]);
      }
    }
  }
  return image;
}

double largestDifference(const Image& a, const Image& b) {
  if (a.width != b.width || a.height != b.height || a.bytes.size() != b.bytes.size()) return 1e9;
  double largest = 0;
  for (std::size_t i = 0; i < a.bytes.size(); ++i) {
    largest = std::max(largest, std::abs(double(a.bytes[i]) - double(b.bytes[i])));
  }
  return largest;
}

TEST(ImageDecode, JpegComesBackInEveryLayout) {
  const Image jpeg = encodeJpeg(pattern(PixelFormat::Rgb8, 161, 97), 95).value();
  EXPECT_EQ(jpegSize(jpeg.bytes).value(), (ImageSize{161, 97}));
  EXPECT_LT(largestDifference(*decodeImage(jpeg, PixelFormat::Rgb8), pattern(PixelFormat::Rgb8, 161, 97)), 6);
  EXPECT_LT(largestDifference(*decodeImage(jpeg, PixelFormat::Bgr8), pattern(PixelFormat::Bgr8, 161, 97)), 6);
  const Image grey = *decodeImage(pattern(PixelFormat::Rgb8, 161, 97), PixelFormat::Grey8);
  EXPECT_LT(largestDifference(*decodeImage(jpeg, PixelFormat::Grey8), grey), 6);
}

TEST(ImageDecode, AFractionOfTheSizeShowsTheSamePicture) {
  const Image full = pattern(PixelFormat::Rgb8, 161, 97, 5);
  const Image jpeg = encodeJpeg(full, 95).value();
  for (const int divide : {2, 4, 8}) {
    const auto from_jpeg = decodeImage(jpeg, PixelFormat::Rgb8, divide);
    const auto from_plain = decodeImage(full, PixelFormat::Rgb8, divide);
    ASSERT_TRUE(from_jpeg && from_plain);
    EXPECT_EQ(from_jpeg->width, (161 + divide - 1) / divide);
    EXPECT_EQ(from_jpeg->height, (97 + divide - 1) / divide);
    EXPECT_LT(largestDifference(*from_jpeg, *from_plain), 10) << divide;
  }
}

// Sides that no divisor divides: the last row and column average what there is.
TEST(ImageDecode, WordsHoldTheSamePixelsAsRgb) {
  Image rgb;
  rgb.format = PixelFormat::Rgb8;
  rgb.width = 53;
  rgb.height = 37;
  rgb.stride = 3 * rgb.width + 5;
  for (int i = 0; i < rgb.stride * rgb.height; ++i)
    rgb.bytes.push_back(static_cast<std::uint8_t>((static_cast<unsigned>(i) * 2654435761U) >> 13));
  Image bgr = rgb;
  bgr.format = PixelFormat::Bgr8;
  for (const Image& image : {rgb, bgr, *encodeJpeg(rgb, 90), *decodeImage(rgb, PixelFormat::Grey8)})
    for (const int divide : {1, 2, 4, 8}) {
      const auto plain = decodeImage(image, PixelFormat::Rgb8, divide);
      const auto words = decodeImageWords(image, divide);
      ASSERT_TRUE(plain && words);
      ASSERT_EQ(words->width, plain->width);
      ASSERT_EQ(words->height, plain->height);
      ASSERT_EQ(words->rgbx.size() / 4 * 3, plain->bytes.size());
      for (std::size_t i = 0; i < plain->bytes.size(); ++i)
        ASSERT_EQ(words->rgbx[i / 3 * 4 + i % 3], plain->bytes[i]) << "by " << divide << " at " << i;
    }
  EXPECT_FALSE(decodeImageWords(rgb, 3));
}

TEST(ImageDecode, Nv12HasTheColoursOfItsJpeg) {
  Image nv12;
  nv12.format = PixelFormat::Nv12;
  nv12.width = 63;
  nv12.height = 41;
  nv12.stride = 80;
  nv12.bytes.assign(80 * (41 + 21), 0);
  for (int y = 0; y < 41; ++y) {
    for (int x = 0; x < 63; ++x)
      nv12.bytes[static_cast<std::size_t>(80 * y + x)] = static_cast<std::uint8_t>(60 + 2 * x);
  }
  for (int y = 0; y < 21; ++y) {
    for (int x = 0; x < 32; ++x) {
      nv12.bytes[static_cast<std::size_t>(80 * (41 + y) + 2 * x)] = static_cast<std::uint8_t>(100 + y);
      nv12.bytes[static_cast<std::size_t>(80 * (41 + y) + 2 * x + 1)] =
          static_cast<std::uint8_t>(150 - x / 2);
    }
  }
  const auto direct = decodeImage(nv12, PixelFormat::Rgb8);
  const auto jpeg = encodeJpeg(nv12, 98);
  ASSERT_TRUE(direct && jpeg);
  EXPECT_LT(largestDifference(*direct, *decodeImage(*jpeg, PixelFormat::Rgb8)), 12);
}

TEST(ImageDecode, CutAndDamagedJpegsAreBadInputOrAWholePicture) {
  const Image good = encodeJpeg(pattern(PixelFormat::Rgb8, 160, 120), 90).value();
  for (std::size_t keep = 0; keep < good.bytes.size() - 2; keep += 37) {
    Image cut = good;
    cut.bytes.resize(keep);
    const auto result = decodeImage(cut, PixelFormat::Rgb8);
    ASSERT_FALSE(result) << keep;
    ASSERT_EQ(result.error().code, ErrorCode::BadInput);
  }
  for (unsigned seed = 0; seed < 500; ++seed) {
    std::mt19937 random(seed);
    Image damaged = good;
    for (int i = 0; i < 5; ++i)
      damaged.bytes[random() % damaged.bytes.size()] = static_cast<std::uint8_t>(random());
    const auto result = decodeImage(damaged, PixelFormat::Grey8, 2);
    if (!result) {
      ASSERT_EQ(result.error().code, ErrorCode::BadInput) << seed;
    }
  }
}

TEST(ImageDecode, AHeaderWithAnAbsurdSizeTakesNoMemory) {
  Image jpeg = encodeJpeg(pattern(PixelFormat::Grey8, 16, 16), 90).value();
  for (std::size_t i = 0; i + 9 < jpeg.bytes.size(); ++i) {
    if (jpeg.bytes[i] == 0xff && jpeg.bytes[i + 1] == 0xc0) {  // SOF0: height and width at 5 and 7
      jpeg.bytes[i + 5] = jpeg.bytes[i + 7] = 0xff;
    }
  }
  EXPECT_EQ(decodeImage(jpeg, PixelFormat::Rgb8).error().code, ErrorCode::BadInput);
  EXPECT_EQ(jpegSize(jpeg.bytes).error().code, ErrorCode::BadInput);
}

TEST(ImageDecode, PlainImagesWhoseSizesDoNotFitAreBadInput) {
  Image image = pattern(PixelFormat::Rgb8, 20, 10);
  image.bytes.pop_back();
  EXPECT_EQ(decodeImage(image, PixelFormat::Grey8).error().code, ErrorCode::BadInput);
  image = pattern(PixelFormat::Rgb8, 20, 10);
  image.stride = 59;
  EXPECT_EQ(decodeImage(image, PixelFormat::Grey8).error().code, ErrorCode::BadInput);
  image = pattern(PixelFormat::Grey8, 20, 10);
  image.width = -20;
  EXPECT_EQ(decodeImage(image, PixelFormat::Grey8).error().code, ErrorCode::BadInput);
  EXPECT_EQ(decodeImage(Image{}, PixelFormat::Grey8).error().code, ErrorCode::BadInput);
}

}  // namespace
}  // namespace overfly::capture
