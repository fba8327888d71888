// What elevation costs in bytes and time, ours beside lossless WebP and LERC at the same step, and what the
// colour and quality layers cost. Counters: bytes per tile, and the largest error in steps.
#include <benchmark/benchmark.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <memory>

#ifdef OVERFLY_HAS_LERC
#include <Lerc_c_api.h>
#endif

#include "tests/bench/store/samples.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {
namespace {

constexpr double kStep = 0.01;
using Bytes = std::vector<std::uint8_t>;

struct Coder {
  std::function<Bytes(const std::vector<float>&)> encode;
  std::function<std::vector<float>(const Bytes&)> decode;
};

// The quantised height in 24 bits of the three colours, no data in alpha: what a web terrain tile is.
Coder webp(int level) {
  return {[level](const std::vector<float>& heights) {
            std::vector<std::uint8_t> rgba(4 * heights.size());
            for (std::size_t i = 0; i < heights.size(); ++i) {
              if (std::isnan(heights[i])) continue;
              const auto steps = static_cast<std::uint32_t>(std::lround((heights[i] + 1000) / kStep));
              rgba[4 * i] = static_cast<std::uint8_t>(steps >> 16);
              rgba[4 * i + 1] = static_cast<std::uint8_t>(steps >> 8);
              rgba[4 * i + 2] = static_cast<std::uint8_t>(steps);
              rgba[4 * i + 3] = 255;
            }
            WebPConfig config;
            WebPConfigInit(&config);
            WebPConfigLosslessPreset(&config, level);
            WebPPicture picture;
            WebPPictureInit(&picture);
            picture.use_argb = 1;
            picture.width = picture.height = kBenchSize;
            WebPMemoryWriter writer;
            WebPMemoryWriterInit(&writer);
            picture.writer = WebPMemoryWrite;
            picture.custom_ptr = &writer;
            WebPPictureImportRGBA(&picture, rgba.data(), 4 * kBenchSize);
            WebPEncode(&config, &picture);
            Bytes bytes(writer.mem, writer.mem + writer.size);
            WebPMemoryWriterClear(&writer);
            WebPPictureFree(&picture);
            return bytes;
          },
          [](const Bytes& bytes) {
            std::vector<std::uint8_t> rgba(4 * kBenchSize * kBenchSize);
            WebPDecodeRGBAInto(bytes.data(), bytes.size(), rgba.data(), rgba.size(), 4 * kBenchSize);
            std::vector<float> heights(rgba.size() / 4);
            for (std::size_t i = 0; i < heights.size(); ++i)
              heights[i] =
                  rgba[4 * i + 3] == 0
                      ? std::nanf("")
                      : static_cast<float>(
                            (rgba[4 * i] << 16 | rgba[4 * i + 1] << 8 | rgba[4 * i + 2]) * kStep - 1000);
            return heights;
          }};
}

Coder ours(HeightPredictor predictor, int level) {
  return {[=](const std::vector<float>& heights) {
            return encodeHeights(heights, kBenchSize, {kStep, level, predictor}).value();
          },
          [](const Bytes& bytes) { return decodeHeights(bytes, kBenchSize).value(); }};
}

Coder exact() {
  return {[](const std::vector<float>& heights) { return encodeExactHeights(heights, kBenchSize).value(); },
          [](const Bytes& bytes) { return decodeExactHeights(bytes, kBenchSize).value(); }};
}

#ifdef OVERFLY_HAS_LERC
Coder lerc() {
  return {[](const std::vector<float>& heights) {
            std::vector<unsigned char> mask(heights.size());
            for (std::size_t i = 0; i < heights.size(); ++i) mask[i] = std::isnan(heights[i]) ? 0 : 1;
            Bytes bytes(heights.size() * 5 + 1000);
            unsigned int written = 0;
            constexpr unsigned int kFloat = 6;
            lerc_encode(heights.data(), kFloat, 1, kBenchSize, kBenchSize, 1, 1, mask.data(), kStep / 2,
                        bytes.data(), static_cast<unsigned>(bytes.size()), &written);
            bytes.resize(written);
            return bytes;
          },
          [](const Bytes& bytes) {
            std::vector<float> heights(kBenchSize * kBenchSize);
            std::vector<unsigned char> mask(heights.size());
            lerc_decode(bytes.data(), static_cast<unsigned>(bytes.size()), 1, mask.data(), 1, kBenchSize,
                        kBenchSize, 1, 6, heights.data());
            for (std::size_t i = 0; i < heights.size(); ++i)
              if (mask[i] == 0) heights[i] = std::nanf("");
            return heights;
          }};
}
#endif

void encodeElevation(benchmark::State& state, const Coder& coder) {
  const auto& samples = elevationSamples();
  std::size_t bytes = 0, tiles = 0;
  for (auto _ : state) {
    bytes += coder.encode(samples[tiles % samples.size()]).size();
    ++tiles;
  }
  // Over each sample once, whatever the number of iterations.
  double total = 0, error = 0;
  for (const std::vector<float>& sample : samples) {
    const Bytes coded = coder.encode(sample);
    const std::vector<float> back = coder.decode(coded);
    total += static_cast<double>(coded.size());
    for (std::size_t i = 0; i < sample.size(); ++i) {
      if (std::isnan(sample[i]) != std::isnan(back[i])) {
        state.SkipWithError("no-data did not survive");
        return;
      }
      if (!std::isnan(sample[i])) error = std::max(error, std::abs(double{sample[i]} - back[i]) / kStep);
    }
  }
  benchmark::DoNotOptimize(bytes);
  state.counters["bytes"] = total / static_cast<double>(samples.size());
  state.counters["error_steps"] = error;
  if (!samplesAreReal()) state.SetLabel("made-up heights");
}

void decodeElevation(benchmark::State& state, const Coder& coder) {
  std::vector<Bytes> coded;
  for (const auto& sample : elevationSamples()) coded.push_back(coder.encode(sample));
  std::size_t tiles = 0;
  for (auto _ : state) benchmark::DoNotOptimize(coder.decode(coded[tiles++ % coded.size()]));
}

void color(benchmark::State& state, ColorFormat format, int method) {
  std::vector<Tile> tiles;
  for (std::size_t i = 0; i < 16; ++i) {
    tiles.push_back(tileOver(i));
    if (format == ColorFormat::Auto)  // the case without a hole
      for (std::size_t texel = 3; texel < tiles.back().color.size(); texel += 4)
        tiles.back().color[texel] = 255;
  }
  std::size_t done = 0, bytes = 0;
  for (auto _ : state)
    bytes += encodeColor(tiles[done++ % tiles.size()].color, kBenchSize, {format, 85, method})->bytes.size();
  state.counters["bytes"] = static_cast<double>(bytes) / static_cast<double>(done);
}

void wholeTile(benchmark::State& state, bool with_holes) {
  std::vector<Tile> tiles;
  for (std::size_t i = 0; i < 16; ++i) {
    tiles.push_back(tileOver(i));
    for (std::size_t texel = 0; !with_holes && texel < tiles.back().texels(); ++texel) {
      tiles.back().color[4 * texel + 3] = 255;
      if (std::isnan(tiles.back().elevation[texel])) tiles.back().elevation[texel] = 300;
    }
  }
  std::size_t done = 0;
  std::map<std::string, double> bytes;
  for (auto _ : state) {
    const TileWrite write = encodeTile(tiles[done++ % tiles.size()], {}).value();
    for (const EncodedLayer& layer : write.layers)
      bytes[std::string(name(layer.layer))] += static_cast<double>(layer.bytes.size());
  }
  for (const auto& [layer, sum] : bytes) state.counters[layer] = sum / static_cast<double>(done);
}

[[maybe_unused]] const bool kRegistered = [] {
  const auto add = [](const std::string& name, const Coder& coder) {
    benchmark::RegisterBenchmark(("elevation/encode/" + name).c_str(), [coder](benchmark::State& state) {
      encodeElevation(state, coder);
    })->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark(("elevation/decode/" + name).c_str(), [coder](benchmark::State& state) {
      decodeElevation(state, coder);
    })->Unit(benchmark::kMillisecond);
  };
  for (const int level : {1, 3, 9, 19}) {
    add("median+zstd" + std::to_string(level), ours(HeightPredictor::Median, level));
    add("plane+zstd" + std::to_string(level), ours(HeightPredictor::Plane, level));
    add("left+zstd" + std::to_string(level), ours(HeightPredictor::Left, level));
  }
  for (const int level : {0, 3, 6}) add("webp" + std::to_string(level), webp(level));
#ifdef OVERFLY_HAS_LERC
  add("lerc", lerc());
#endif
  add("exact", exact());
  for (const auto& [name, format, method] : {std::tuple{"jpeg", ColorFormat::Auto, 0},
                                             {"webp0", ColorFormat::Webp, 0},
                                             {"webp1", ColorFormat::Webp, 1},
                                             {"webp4", ColorFormat::Webp, 4}})
    benchmark::RegisterBenchmark((std::string("color/encode/") + name).c_str(), [format = format,
                                                                                 method = method](
                                                                                    benchmark::State& state) {
      color(state, format, method);
    })->Unit(benchmark::kMillisecond);
  for (const bool with_holes : {false, true})
    benchmark::RegisterBenchmark(with_holes ? "tile/encode/holes" : "tile/encode/full",
                                 [with_holes](benchmark::State& state) { wholeTile(state, with_holes); })
        ->Unit(benchmark::kMillisecond);
  return true;
}();

}  // namespace
}  // namespace overfly::tiling
