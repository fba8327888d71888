// R*-tree insert and window query: Boost.Geometry, as FrameIndex uses it, against libspatialindex, on the
// same 1e5 boxes: view pyramids of a survey in ECEF (400 strips of 250 frames, 30 m apart, 100 m above
// ground), windows of one tile each (25 m), the same for both. FrameIndex itself beside them.
#include <benchmark/benchmark.h>
#include <spatialindex/SpatialIndex.h>

#include <algorithm>
#include <boost/geometry.hpp>
#include <boost/geometry/geometries/box.hpp>
#include <boost/geometry/geometries/point.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <memory>
#include <random>

#include "tiling/index/frame_index.h"

namespace overfly::tiling {
namespace {

namespace bg = boost::geometry;
namespace bgi = boost::geometry::index;
using Point = bg::model::point<double, 3, bg::cs::cartesian>;
using Box = bg::model::box<Point>;
using Entry = std::pair<Box, std::uint64_t>;
using Tree = bgi::rtree<Entry, bgi::rstar<16>>;

constexpr int kStrips = 400, kPerStrip = 250;

struct Data {
  std::vector<IndexedFrame> frames;  // in a shuffled order, the same for all
  std::vector<geo::Box3> windows;
  geo::TileLattice lattice = geo::TileLattice::webMercator();

  Data() {
    const geo::Geodetic centre{geo::radians(48.4), geo::radians(9.99), 400};
    const geo::LocalFrame local(centre);
    capture::CameraModel camera;
    camera.width = 4000;
    camera.height = 3000;
    camera.fx = camera.fy = 3000;
    camera.cx = 2000;
    camera.cy = 1500;
    std::mt19937 random(7);
    std::normal_distribution<double> noise(0, 2);
    for (int strip = 0; strip < kStrips; ++strip)
      for (int i = 0; i < kPerStrip; ++i) {
        const geo::Geodetic at = geo::geodeticFromEcef(
            local.ecefFromEnu({30.0 * (i - kPerStrip / 2) + noise(random),
                               30.0 * (strip - kStrips / 2) + noise(random), 100 + noise(random)}));
        capture::Pose pose;
        pose.position_in_ecef = geo::ecefFromGeodetic(at);
        pose.ecef_from_camera =
            Eigen::Quaterniond(Eigen::Matrix3d(geo::LocalFrame(at).enuFromEcefRotation().transpose())) *
            geo::enuFromCamera(strip % 2 == 0 ? 0 : 3.14159, -1.5708 + 0.02 * noise(random),
                               0.02 * noise(random));
        frames.push_back(
            makeIndexedFrame(static_cast<std::uint64_t>(frames.size()), camera, pose, 1, lattice, 0.5277, 400)
                .value());
        if (i % 10 == 0 && strip % 10 == 0) {
          const Eigen::Vector3d ground = geo::ecefFromGeodetic({at.lat, at.lon, 400});
          windows.push_back({ground.array() - 12.5, ground.array() + 12.5});
        }
      }
    std::shuffle(frames.begin(), frames.end(), random);
  }
};

const Data& data() {
  static const Data once;
  return once;
}

Box boostBox(const geo::Box3& box) {
  return {{box.min.x(), box.min.y(), box.min.z()}, {box.max.x(), box.max.y(), box.max.z()}};
}

Tree boostTree() {
  Tree tree;
  for (const IndexedFrame& frame : data().frames) tree.insert({boostBox(frame.pyramid_in_ecef), frame.id});
  return tree;
}

struct SpatialIndexTree {
  std::unique_ptr<SpatialIndex::IStorageManager> storage{
      SpatialIndex::StorageManager::createNewMemoryStorageManager()};
  std::unique_ptr<SpatialIndex::ISpatialIndex> tree;

  SpatialIndexTree() {
    SpatialIndex::id_type id = 0;
    tree.reset(
        SpatialIndex::RTree::createNewRTree(*storage, 0.3, 16, 16, 3, SpatialIndex::RTree::RV_RSTAR, id));
    for (const IndexedFrame& frame : data().frames) {
      const SpatialIndex::Region region(frame.pyramid_in_ecef.min.data(), frame.pyramid_in_ecef.max.data(),
                                        3);
      tree->insertData(0, nullptr, region, static_cast<SpatialIndex::id_type>(frame.id));
    }
  }
};

struct Count : SpatialIndex::IVisitor {
  std::uint64_t hits = 0;
  void visitNode(const SpatialIndex::INode&) override {}
  void visitData(const SpatialIndex::IData&) override { ++hits; }
  void visitData(std::vector<const SpatialIndex::IData*>&) override {}
};

void perItem(benchmark::State& state, std::size_t items) {
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) * static_cast<std::int64_t>(items));
}

void insertBoost(benchmark::State& state) {
  data();
  for (auto _ : state) benchmark::DoNotOptimize(boostTree());
  perItem(state, data().frames.size());
}
void insertSpatialIndex(benchmark::State& state) {
  data();
  for (auto _ : state) SpatialIndexTree tree;
  perItem(state, data().frames.size());
}
// Records, both trees and the area.
void insertFrameIndex(benchmark::State& state) {
  for (auto _ : state) {
    FrameIndex index(data().lattice);
    for (const IndexedFrame& frame : data().frames) index.insert(frame);
    benchmark::DoNotOptimize(index.size());
  }
  perItem(state, data().frames.size());
}
void rebuildFrameIndex(benchmark::State& state) {
  for (auto _ : state) {
    FrameIndex index(data().lattice);
    index.rebuild(data().frames);
    benchmark::DoNotOptimize(index.size());
  }
  perItem(state, data().frames.size());
}

void queryBoost(benchmark::State& state) {
  const Tree tree = boostTree();
  std::uint64_t hits = 0;
  for (auto _ : state) {
    hits = 0;
    for (const geo::Box3& window : data().windows) {
      std::vector<Entry> found;
      tree.query(bgi::intersects(boostBox(window)), std::back_inserter(found));
      hits += found.size();
    }
  }
  state.counters["hits"] = static_cast<double>(hits);
  perItem(state, data().windows.size());
}
void querySpatialIndex(benchmark::State& state) {
  const SpatialIndexTree tree;
  Count count;
  for (auto _ : state) {
    count.hits = 0;
    for (const geo::Box3& window : data().windows)
      tree.tree->intersectsWithQuery(SpatialIndex::Region(window.min.data(), window.max.data(), 3), count);
  }
  state.counters["hits"] = static_cast<double>(count.hits);
  perItem(state, data().windows.size());
}
// With the exact test of the view against the tile, sorted by id.
void queryFrameIndexTile(benchmark::State& state) {
  FrameIndex index(data().lattice);
  index.rebuild(data().frames);
  std::vector<geo::TileKey> keys;
  for (std::size_t i = 0; i < data().frames.size(); i += 100)
    keys.push_back(geo::TileLattice::keyAt(data().frames[i].nadir, 20));
  std::uint64_t hits = 0;
  for (auto _ : state) {
    hits = 0;
    for (const geo::TileKey& key : keys) hits += index.framesForTile(key, 400, 420).size();
  }
  state.counters["hits"] = static_cast<double>(hits);
  perItem(state, keys.size());
}

BENCHMARK(insertBoost)->Unit(benchmark::kMillisecond)->Iterations(2);
BENCHMARK(insertSpatialIndex)->Unit(benchmark::kMillisecond)->Iterations(2);
BENCHMARK(insertFrameIndex)->Unit(benchmark::kMillisecond)->Iterations(1);
BENCHMARK(rebuildFrameIndex)->Unit(benchmark::kMillisecond)->Iterations(2);
BENCHMARK(queryBoost)->Unit(benchmark::kMillisecond);
BENCHMARK(querySpatialIndex)->Unit(benchmark::kMillisecond);
BENCHMARK(queryFrameIndexTile)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace overfly::tiling
