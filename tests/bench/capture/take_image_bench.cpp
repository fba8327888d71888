#include <benchmark/benchmark.h>
#include <linux/videodev2.h>

#include <cstring>
#include <numeric>
#include <vector>

#include "capture/pixel_layout.h"

// What taking one 1920x1080 picture out of a driver's buffer costs the processor, by format, beside the plain
// copy of as many bytes, which no path without zero copy can beat.
namespace {

using namespace overfly::capture;

constexpr int kWidth = 1920, kHeight = 1080;

std::vector<std::uint8_t> bufferOf(std::size_t bytes) {
  std::vector<std::uint8_t> buffer(bytes);
  std::iota(buffer.begin(), buffer.end(), std::uint8_t{0});
  return buffer;
}

void takeImageOf(benchmark::State& state, std::uint32_t fourcc, int stride, std::size_t bytes, bool limited) {
  const auto buffer = bufferOf(bytes);
  const auto layout = layoutOf(fourcc);
  for (auto _ : state) {
    auto image = takeImage(buffer, *layout, kWidth, kHeight, stride, limited);
    if (!image) state.SkipWithError(image.error().message.c_str());
    benchmark::DoNotOptimize(image);
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
}

void copyOf(benchmark::State& state, std::size_t bytes) {
  const auto buffer = bufferOf(bytes);
  for (auto _ : state) {
    std::vector<std::uint8_t> copy(bytes);
    std::memcpy(copy.data(), buffer.data(), bytes);
    benchmark::DoNotOptimize(copy.data());
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
}

constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;

BENCHMARK_CAPTURE(copyOf, nv12, kPixels * 3 / 2)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(copyOf, yuyv, kPixels * 2)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(takeImageOf, grey, V4L2_PIX_FMT_GREY, kWidth, kPixels, false)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(takeImageOf, nv12, V4L2_PIX_FMT_NV12, kWidth, kPixels * 3 / 2, false)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(takeImageOf, nv12_limited, V4L2_PIX_FMT_NV12, kWidth, kPixels * 3 / 2, true)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(takeImageOf, yuyv_limited, V4L2_PIX_FMT_YUYV, 2 * kWidth, kPixels * 2, true)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(takeImageOf, bayer8, V4L2_PIX_FMT_SRGGB8, kWidth, kPixels, false)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(takeImageOf, bayer10, V4L2_PIX_FMT_SRGGB10, 2 * kWidth, kPixels * 2, false)
    ->Unit(benchmark::kMillisecond);

}  // namespace
