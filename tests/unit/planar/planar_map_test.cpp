#include "tiling/planar/planar_map.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>
#include <set>

#include "capture/geo/footprint.h"
#include "capture/geo/tile_frame.h"
#include "tiling/clipmap/parent.h"

namespace overfly::tiling {
namespace {

constexpr double kGround_m = 400;
constexpr int kWidth = 400, kHeight = 300;

// A camera 40 m above the plane sees 0.16 m a pixel.
capture::CameraModel testCamera(bool distorted) {
  capture::CameraModel camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.fx = camera.fy = 250;
  camera.cx = 203;
  camera.cy = 148;
  if (distorted) {
    camera.kind = capture::CameraModel::Kind::RadialTangential;
    camera.distortion = {-0.08, 0.02, 0.001, -0.0015};
  }
  return camera;
}

const geo::LocalFrame& site() {
  static const geo::LocalFrame local({geo::radians(47.3), geo::radians(8.5), kGround_m});
  return local;
}

capture::FramePtr frameAt(double east, double north, double yaw_deg, double pitch_deg, bool distorted,
                          std::uint8_t (*paint)(int x, int y, int channel)) {
  auto frame = std::make_shared<capture::Frame>();
  frame->name = "test";
  frame->camera = testCamera(distorted);
  capture::Pose pose;
  pose.position_in_ecef = site().ecefFromEnu({east, north, 40});
  const geo::LocalFrame there(geo::geodeticFromEcef(pose.position_in_ecef));
  pose.ecef_from_camera = Eigen::Quaterniond(there.enuFromEcefRotation()).conjugate() *
                          geo::enuFromCamera(geo::radians(yaw_deg), geo::radians(pitch_deg), 0.02);
  frame->pose = pose;
  frame->image.format = capture::PixelFormat::Rgb8;
  frame->image.width = kWidth;
  frame->image.height = kHeight;
  frame->image.stride = 3 * kWidth;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c) frame->image.bytes.push_back(paint(x, y, c));
  return frame;
}

// 25 levels a pixel, up and down over 20 pixels: red along x, green along y.
double wave(double pixel) { return 25 * std::abs(std::fmod(pixel, 20.0) - 10); }
std::uint8_t waves(int x, int y, int channel) {
  return channel == 2 ? 7 : static_cast<std::uint8_t>(std::lround(wave((channel == 0 ? x : y) + 0.5)));
}
bool farFromTurn(double pixel) {
  const double phase = std::fmod(pixel, 10.0);
  return phase > 1.5 && phase < 8.5;
}

geo::TileLattice lattice() { return geo::TileLattice::webMercator(); }
constexpr int kZoom = 20;  // 0.101 m a texel at 256

geo::TileKey keyUnder(double east, double north) {
  const geo::Geodetic place = geo::geodeticFromEcef(site().ecefFromEnu({east, north, 0}));
  return geo::TileLattice::keyAt(*lattice().planeFromGeodetic(place.lat, place.lon), kZoom);
}

TEST(PlanarPlan, TextureLiesWhereTheExactProjectionSays) {
  for (const bool distorted : {false, true})
    for (const double pitch_deg : {-90.0, -80.0, -68.0}) {
      const capture::FramePtr frame = frameAt(0, 0, 33, pitch_deg, distorted, waves);
      auto record = makeIndexedFrame(5, frame->camera, *frame->pose, 0, lattice(), 0.5, kGround_m);
      ASSERT_TRUE(record);
      const IndexedFrame* candidates[] = {&*record};
      const geo::TileKey key = keyUnder(2, 3);
      const PlanarPlan plan(lattice(), key, 256, kGround_m, candidates);
      ASSERT_EQ(plan.frames(), std::vector<std::uint64_t>{5});
      auto image = decodeForPlane(*frame, 0.16, 0.1);
      ASSERT_TRUE(image);
      ASSERT_EQ(image->width, kWidth);
      const std::vector<PlanarImagePtr> images{std::make_shared<const PlanarImage>(std::move(*image))};
      const Tile tile = plan.render(images);
      const geo::TileFrame tile_frame(lattice(), key);
      int compared = 0;
      double worst = 0;
      for (int v = 0; v < 256; v += 3)
        for (int u = 0; u < 256; ++u) {
          const Eigen::Vector3d ecef = tile_frame.local().ecefFromEnu(
              tile_frame.enuFromTexelExact((u + 0.5) / 256, (v + 0.5) / 256, kGround_m));
          const auto pixel = frame->camera.project(frame->pose->ecef_from_camera.conjugate() *
                                                   (ecef - frame->pose->position_in_ecef));
          const std::size_t at = static_cast<std::size_t>(v * 256 + u);
          const bool inside = pixel && pixel->x() > 0.2 && pixel->y() > 0.2 && pixel->x() < kWidth - 0.2 &&
                              pixel->y() < kHeight - 0.2;
          if (!inside) continue;
          ASSERT_EQ(tile.kind[at], kProvisional);
          if (!farFromTurn(pixel->x()) || !farFromTurn(pixel->y())) continue;
          ++compared;
          worst = std::max({worst, std::abs(tile.color[4 * at] - wave(pixel->x())) / 25,
                            std::abs(tile.color[4 * at + 1] - wave(pixel->y())) / 25});
        }
      EXPECT_GT(compared, 5000);
      EXPECT_LT(worst, 0.1 + 0.04) << "pixels; a level is 0.04";
    }
}

TEST(PlanarPlan, EachTexelTakesTheFrameThatLooksMostSteeply) {
  std::vector<IndexedFrame> records;
  std::vector<capture::FramePtr> frames;
  const double places[][2] = {{-12, -4}, {9, 6}, {3, -15}};
  for (std::size_t k = 0; k < 3; ++k) {
    frames.push_back(frameAt(places[k][0], places[k][1], 40.0 * static_cast<double>(k), -90, false, waves));
    records.push_back(
        *makeIndexedFrame(10 + k, frames[k]->camera, *frames[k]->pose, 0, lattice(), 0.5, kGround_m));
  }
  const IndexedFrame* candidates[] = {&records[0], &records[1], &records[2]};
  const geo::TileKey key = keyUnder(0, 0);
  const PlanarPlan plan(lattice(), key, 256, kGround_m, candidates);
  std::vector<PlanarImagePtr> images;
  for (const std::uint64_t id : plan.frames())
    images.push_back(std::make_shared<const PlanarImage>(*decodeForPlane(*frames[id - 10], 0.16, 0.1)));
  const Tile tile = plan.render(images);
  const geo::TileFrame tile_frame(lattice(), key);
  std::set<std::uint64_t> seen;
  for (int v = 0; v < 256; v += 5)
    for (int u = 0; u < 256; u += 5) {
      const Eigen::Vector3d enu = site().enuFromEcef(tile_frame.local().ecefFromEnu(
          tile_frame.enuFromTexelExact((u + 0.5) / 256, (v + 0.5) / 256, kGround_m)));
      double best = 1e9, second = 1e9;
      std::uint64_t expected = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const double away = std::hypot(enu.x() - places[k][0], enu.y() - places[k][1]);
        if (away < best) {
          second = best;
          best = away;
          expected = 10 + k;
        } else {
          second = std::min(second, away);
        }
      }
      if (second - best < 0.3 || best > 20) continue;  // at a border, or at the rim of a picture
      const std::uint16_t source = tile.source[static_cast<std::size_t>(v * 256 + u)];
      ASSERT_NE(source, Tile::kNoSource);
      EXPECT_EQ(tile.frame_set[source], expected);
      seen.insert(expected);
    }
  EXPECT_EQ(seen.size(), 3u);
}

// Whatever the order in which frames come: what is drawn on is what would be drawn anew, also when frames
// leave again, one of them with a plan that was never carried out. Only the pictures of frames that give new
// texels are given.
TEST(PlanarPlan, ATileThatIsDrawnOnIsTheTileDrawnAnew) {
  const double places[][2] = {{-14, -4}, {9, 6}, {3, -15}, {-5, 12}, {1, 0}};
  std::vector<IndexedFrame> records;
  std::vector<PlanarImagePtr> pictures;
  for (std::size_t k = 0; k < 5; ++k) {
    const capture::FramePtr frame =
        frameAt(places[k][0], places[k][1], 40.0 * static_cast<double>(k), -85, true, waves);
    records.push_back(*makeIndexedFrame(10 + k, frame->camera, *frame->pose, 0, lattice(), 0.5, kGround_m));
    pictures.push_back(std::make_shared<const PlanarImage>(*decodeForPlane(*frame, 0.16, 0.1)));
  }
  const geo::TileKey key = keyUnder(0, 0);
  std::size_t read = 0, all = 0;
  for (unsigned seed = 0; seed < 6; ++seed) {
    std::vector<std::size_t> order{0, 1, 2, 3, 4};
    std::shuffle(order.begin(), order.end(), std::mt19937(seed));
    std::set<std::size_t> seen;
    std::optional<Tile> tile;
    PlanarPlan::Marks marks;
    for (std::size_t step = 0; step < 7; ++step) {
      if (step < 5)
        seen.insert(order[step]);
      else
        seen.erase(order[step - 4]);
      std::vector<const IndexedFrame*> candidates;
      for (const std::size_t k : seen) candidates.push_back(&records[k]);
      const PlanarPlan plan(lattice(), key, 256, kGround_m, candidates);
      if (!tile) {
        tile = plan.blank();
        marks = plan.noMarks();
      }
      const PlanarPlan::Changes changes = plan.prepare(*tile, marks);
      const bool some = step == 5 && seed % 2 == 1;  // the other pictures could not be had
      std::vector<PlanarImagePtr> images;
      for (const std::uint64_t id : plan.frames()) images.push_back(pictures[id - 10]);
      // In any order, the last first here.
      for (std::size_t k = images.size(); k-- > 0;) {
        all += step < 5 ? 1 : 0;
        if (!changes.needed[k]) continue;
        read += step < 5 ? 1 : 0;
        plan.draw(changes, k, *images[k], marks, *tile);
        if (some) break;
      }
      if (some) continue;
      plan.finish(changes, *tile, marks);
      ASSERT_TRUE(*tile == plan.render(images)) << "seed " << seed << ", step " << step;
    }
  }
  EXPECT_LT(read, all / 2);
}

std::uint8_t smooth(int x, int y, int channel) {
  return static_cast<std::uint8_t>(128 + 90 * std::sin(0.031 * x + 0.8 * channel) * std::cos(0.043 * y));
}

// A map in a folder of its own, made from frames in the order given.
struct MadeMap {
  std::filesystem::path folder;
  std::optional<MapReader> reader;
  PlanarStatistics statistics;

  MadeMap(const std::string& name, const std::vector<std::size_t>& order, PlanarOptions options = {}) {
    folder = std::filesystem::temp_directory_path() / ("overfly-planar-" + name + std::to_string(getpid()));
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    MapMeta meta;
    meta.base_zoom = kZoom;
    auto store = MapStore::create(folder / "map.overfly", meta);
    EXPECT_TRUE(store);
    options.height_m = kGround_m;
    {
      auto map = PlanarMap::create(std::move(*store), options);
      EXPECT_TRUE(map);
      for (const std::size_t i : order) {
        const capture::FramePtr frame = at(i);
        EXPECT_TRUE((*map)->addFrame(i, frame, [i]() -> Result<capture::FramePtr> { return at(i); }));
      }
      EXPECT_TRUE((*map)->finish());
      statistics = (*map)->statistics();
    }
    reader.emplace(*MapReader::open(folder / "map.overfly"));
  }
  ~MadeMap() {
    reader.reset();
    std::filesystem::remove_all(folder);
  }
  MadeMap(const MadeMap&) = delete;
  MadeMap& operator=(const MadeMap&) = delete;

  static capture::FramePtr at(std::size_t i) {
    return frameAt(20.0 * static_cast<double>(i % 5), 18.0 * static_cast<double>(i / 5), i % 2 == 0 ? 4 : 184,
                   -88, true, smooth);
  }
  std::map<geo::TileKey, Tile> level(int zoom) const {
    std::map<geo::TileKey, Tile> tiles;
    const auto keys = reader->keys(zoom, Layer::Color, {}, SIZE_MAX);
    EXPECT_TRUE(keys);
    for (const geo::TileKey& key : *keys) tiles.emplace(key, *readTile(*reader, key));
    return tiles;
  }
};

std::vector<std::size_t> upTo(std::size_t count) {
  std::vector<std::size_t> order(count);
  for (std::size_t i = 0; i < count; ++i) order[i] = i;
  return order;
}

TEST(PlanarMap, AMapIsAFunctionOfItsFramesNotOfTheirOrder) {
  const MadeMap forward("forward", upTo(15));
  for (int run = 0; run < 3; ++run) {
    std::vector<std::size_t> order = upTo(15);
    std::mt19937 random(static_cast<unsigned>(run));
    std::shuffle(order.begin(), order.end(), random);
    PlanarOptions options;
    options.threads = 1 + run;
    options.ahead = run;
    options.image_bytes = 1u << 20;                // two frames: the others are loaded again
    options.tile_bytes = run == 0 ? 1 : 1u << 22;  // children from the store, and from memory
    const MadeMap shuffled("shuffled", order, options);
    EXPECT_GT(shuffled.statistics.images_loaded, 15u);
    const auto range = forward.reader->zoomRange(Layer::Color);
    ASSERT_TRUE(range);
    EXPECT_LE(range->first, kZoom - 2);
    for (int zoom = range->first; zoom <= kZoom; ++zoom) {
      const auto a = forward.level(zoom), b = shuffled.level(zoom);
      ASSERT_GT(a.size(), 0u);
      EXPECT_TRUE(a == b) << "zoom " << zoom << ", seed " << run;
    }
  }
}

TEST(PlanarMap, ThePyramidIsMadeOfItsStoredTiles) {
  const MadeMap map("pyramid", upTo(15));
  const auto range = map.reader->zoomRange(Layer::Color);
  const EncodeOptions coding = PlanarOptions{}.encoding;
  for (int zoom = range->first; zoom < kZoom; ++zoom) {
    const auto parents = map.level(zoom), children = map.level(zoom + 1);
    for (const auto& [key, parent] : parents) {
      std::array<const Tile*, 4> held{};
      for (int i = 0; i < 4; ++i)
        if (const auto child = children.find(geo::childOf(key, i)); child != children.end())
          held[static_cast<std::size_t>(i)] = &child->second;
      const auto coded = encodeColor(makeParent(key, held).color, 256, coding.color);
      ASSERT_TRUE(coded);
      EXPECT_EQ(parent.color, *decodeColor(coded->codec, coded->bytes, 256));
    }
  }
  EXPECT_TRUE(readTopTile(*map.reader, only(Layer::Color)));
}

TEST(PlanarMap, AFrameWithoutAPictureIsPassedOver) {
  const auto folder =
      std::filesystem::temp_directory_path() / ("overfly-planar-bad" + std::to_string(getpid()));
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  MapMeta meta;
  meta.base_zoom = kZoom;
  PlanarOptions options;
  options.height_m = kGround_m;
  options.ahead = 0;
  auto map = PlanarMap::create(*MapStore::create(folder / "map.overfly", meta), options);
  ASSERT_TRUE(map);
  auto broken = std::make_shared<capture::Frame>(*MadeMap::at(0));
  broken->image.bytes.resize(100);
  const auto load = []() -> Result<capture::FramePtr> { return MadeMap::at(1); };
  const auto refused = (*map)->addFrame(0, broken, load);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::BadInput);
  auto lost = std::make_shared<capture::Frame>(*MadeMap::at(0));
  lost->pose.reset();
  EXPECT_FALSE((*map)->addFrame(2, lost, load));
  EXPECT_TRUE((*map)->addFrame(1, MadeMap::at(1), load));
  EXPECT_TRUE((*map)->finish());
  EXPECT_GT((*map)->statistics().tiles, 10u);
  map->reset();
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace overfly::tiling
