#include <random>

#include "tests/unit/store/store_fixture.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {
namespace {

class TileCodecTest : public StoreTest {
 protected:
  static constexpr int kSize = 64;

  // Ground with a house and a hole, noisy planes.
  static Tile scene(unsigned seed, bool with_hole = true) {
    std::mt19937 random(seed);
    Tile tile = Tile::blank({20, 5, 6}, kSize);
    tile.frame_set = {4, 8, 15};
    for (std::size_t i = 0; i < tile.texels(); ++i) {
      const std::size_t x = i % kSize, y = i / kSize;
      if (with_hole && x > 40 && y > 50) continue;
      const bool house = x > 10 && x < 20 && y > 30 && y < 50;
      tile.elevation[i] = 320.0F + 0.03F * static_cast<float>(x) + (house ? 7.5F : 0.0F) +
                          0.02F * static_cast<float>(random() % 100) / 100;
      for (std::size_t c = 0; c < 3; ++c)
        tile.color[4 * i + c] = static_cast<std::uint8_t>(100 + random() % 20);
      tile.color[4 * i + 3] = 255;
      tile.confidence[i] = static_cast<std::uint8_t>(random() % 256);
      tile.views[i] = static_cast<std::uint8_t>(2 + random() % 5);
      tile.kind[i] = random() % 10 == 0 ? kFilled : kMeasured;
      tile.source[i] = static_cast<std::uint16_t>(random() % 3);
      tile.gsd[i] = gsdCode(0.05);
      tile.angle[i] = angleCode(0.01 * static_cast<double>(random() % 100));
    }
    return tile;
  }
  static MapMeta meta() {
    MapMeta meta;
    meta.tile_size = kSize;
    meta.base_zoom = 20;
    return meta;
  }
};

TEST_F(TileCodecTest, ATileComesBackFromTheStore) {
  const Tile tile = scene(1);
  auto store = MapStore::create(path(), meta());
  ASSERT_TRUE(store) << store.error().message;
  EncodeOptions options = encodeOptions(store->meta());
  options.confidence_levels = 255;
  options.state = true;
  Batch batch;
  batch.tiles = {encodeTile(tile, options).value()};
  EXPECT_NEAR(batch.tiles[0].gsd_m, 0.05, 0.0015);
  EXPECT_FALSE(batch.tiles[0].provisional);
  ASSERT_TRUE(store->commit(batch));
  const auto reader = store->reader();
  Tile back = readTile(*reader, tile.key, kTileLayers | only(Layer::State)).value();
  for (std::size_t i = 3; i < back.color.size(); i += 4) ASSERT_EQ(back.color[i], tile.color[i]);
  back.color = tile.color;  // lossy, see the codec's own tests
  EXPECT_EQ(back, tile) << "with the state layer all else is exact";
  const Tile quantised = readTile(*reader, tile.key).value();
  for (std::size_t i = 0; i < tile.texels(); ++i) {
    ASSERT_EQ(std::isnan(quantised.elevation[i]), std::isnan(tile.elevation[i]));
    if (!std::isnan(tile.elevation[i])) {
      ASSERT_NEAR(quantised.elevation[i], tile.elevation[i], 0.00502);
    }
  }
  EXPECT_TRUE(readTile(*reader, tile.key, only(Layer::Color))->elevation.empty());
  EXPECT_EQ(readTile(*reader, {20, 0, 0}).error().code, ErrorCode::NotFound);
}

TEST_F(TileCodecTest, StatisticsAreThoseOfTheDecodedLayers) {
  const Tile tile = scene(2);
  const TileWrite write = encodeTile(tile, {}).value();
  const std::size_t holes = (kSize - 41) * (kSize - 51);
  ASSERT_EQ(write.layers.size(), 4u);
  for (const EncodedLayer& layer : write.layers)
    if (layer.layer != Layer::ElevationMax) {
      EXPECT_EQ(layer.statistics.valid, tile.texels() - holes) << name(layer.layer);
    }
  const auto decoded = decodeHeights(write.layers[1].bytes, kSize).value();
  float most = -1e9F;
  for (const float height : decoded) most = std::fmax(most, height);
  EXPECT_EQ(write.layers[1].statistics.max, most);
}

// The bound holds for every point of the surface that a renderer interpolates between decoded texels, at
// every level: a parent takes its children's bound with it.
TEST_F(TileCodecTest, TheBoundIsNeverBelowTheBilinearSurface) {
  std::mt19937 random(7);
  for (unsigned seed = 0; seed < 20; ++seed) {
    Tile tile = scene(seed, seed % 2 == 0);
    if (seed % 3 == 0)
      for (float& height : tile.elevation) height += static_cast<float>(random() % 1000) * 0.0137F;
    std::vector<float> given;
    if (seed % 5 == 0) given.assign(tile.texels(), 326.5F);
    EncodeOptions options;
    options.state = seed % 4 == 0;
    const TileWrite write = encodeTile(tile, options, given).value();
    std::vector<float> bound;
    std::vector<StoredLayer> layers;
    for (const EncodedLayer& layer : write.layers) {
      if (layer.layer == Layer::ElevationMax) bound = decodeBound(layer.bytes, kSize).value();
      layers.push_back({layer, 1});
    }
    const Tile back = decodeTile({}, layers, kSize).value();
    const auto at = [&](int x, int y) {
      return static_cast<std::size_t>(std::clamp(y, 0, kSize - 1)) * kSize +
             static_cast<std::size_t>(std::clamp(x, 0, kSize - 1));
    };
    for (std::size_t i = 0; i < given.size(); ++i) ASSERT_GE(bound[i], given[i]);
    for (int i = 0; i < 20000; ++i) {
      const double u = static_cast<double>(random() % 6400) / 100,
                   v = static_cast<double>(random() % 6400) / 100;
      const int x = static_cast<int>(std::floor(u - 0.5)), y = static_cast<int>(std::floor(v - 0.5));
      const double fx = u - 0.5 - x, fy = v - 0.5 - y;
      const double surface =
          (1 - fy) * ((1 - fx) * back.elevation[at(x, y)] + fx * back.elevation[at(x + 1, y)]) +
          fy * ((1 - fx) * back.elevation[at(x, y + 1)] + fx * back.elevation[at(x + 1, y + 1)]);
      if (std::isnan(surface)) continue;
      ASSERT_GE(double{bound[at(static_cast<int>(u), static_cast<int>(v))]} + 1e-9, surface);
    }
  }
}

TEST_F(TileCodecTest, CoarseConfidenceKeepsNoneApartFromLittle) {
  Tile tile = scene(3);
  for (std::size_t i = 0; i < 256; ++i) tile.confidence[i] = static_cast<std::uint8_t>(i);
  const TileWrite write = encodeTile(tile, {}).value();
  std::vector<StoredLayer> layers;
  for (const EncodedLayer& layer : write.layers) layers.push_back({layer, 1});
  const Tile back = decodeTile({}, layers, kSize).value();
  for (std::size_t i = 0; i < 256; ++i) {
    EXPECT_EQ(back.confidence[i] == 0, i == 0);
    EXPECT_NEAR(back.confidence[i], static_cast<double>(i), i < 17 ? 16 : 9);
  }
  EXPECT_EQ(back.confidence[255], 255);
  EXPECT_EQ(back.source, tile.source);
  EXPECT_EQ(back.gsd, tile.gsd);
  EXPECT_EQ(back.angle, tile.angle);
}

TEST_F(TileCodecTest, AMisshapenTileIsRefused) {
  Tile tile = scene(4);
  tile.elevation.pop_back();
  EXPECT_EQ(encodeTile(tile, {}).error().code, ErrorCode::BadInput);
  tile = scene(4);
  tile.frame_set = {5, 5};
  EXPECT_EQ(encodeTile(tile, {}).error().code, ErrorCode::BadInput);
  EXPECT_EQ(encodeTile(scene(4), {}, std::vector<float>(3)).error().code, ErrorCode::BadInput);
}

}  // namespace
}  // namespace overfly::tiling
