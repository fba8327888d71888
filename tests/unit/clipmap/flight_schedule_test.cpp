#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "tests/unit/index/frames.h"
#include "tiling/clipmap/improvable.h"
#include "tiling/clipmap/scheduler.h"

// A survey flown against a clock of its own: what a machine with given times per piece of work makes of it.
namespace overfly::tiling {
namespace {

using geo::TileKey;
using Kind = TileJob::Kind;

constexpr int kZoom = 20;
constexpr double kGroundM = 400;

struct Machine {
  double frame_s = 0.3, sweep_s = 0.12, finish_s = 0.11, parent_s = 0.02;
};

struct Flown {
  double flight_s = 0, busy_s = 0, drained_s = 0;
  std::size_t cells = 0, sweeps = 0, finishes = 0;
  double first_sweep_s = 0;  // median, from the first frame that sees a cell
  bool final_sets = true;    // every cell was last swept with what all frames together select
  bool blended = true;       // ... and finished after the last sweep of each of its neighbours
};

// Six strips there and back, 75 % side and 82 % forward overlap, a frame every 2.1 s: as the flight
// caliterra.
Flown fly(const SchedulerOptions& options, const Machine& machine) {
  const testing::Site site = testing::siteAt(geo::TileLattice::webMercator(), 48.4, 9.99, kGroundM);
  std::vector<IndexedFrame> frames;
  for (int strip = 0; strip < 6; ++strip)
    for (int i = 0; i < 12; ++i)
      frames.push_back(
          testing::frame(site, frames.size(), 33.0 * strip, 18.0 * (strip % 2 == 0 ? i : 11 - i), 100));
  const double interval_s = 2.13;
  FrameIndex index(site.lattice);
  Scheduler scheduler(kZoom, options);
  Flown flown;
  flown.flight_s = interval_s * static_cast<double>(frames.size() - 1);
  double now_s = 0;
  const auto ns = [&] { return static_cast<std::int64_t>(now_s * 1e9); };
  const auto spend = [&](double s) {
    now_s += s;
    flown.busy_s += s;
  };
  const auto setOf = [&](const TileKey& key) {
    std::vector<std::uint64_t> ids;
    for (const SelectedView& view :
         selectViews(index.framesForTile(key, kGroundM, kGroundM), site.lattice, key, kGroundM))
      ids.push_back(view.id);
    return ids;
  };
  std::map<TileKey, std::vector<std::uint64_t>> swept;
  std::map<TileKey, double> seen_s, first_s, swept_s, finished_s;
  std::size_t arrived = 0;
  for (;;) {
    while (arrived < frames.size() && interval_s * static_cast<double>(arrived) <= now_s) {
      const IndexedFrame& frame = frames[arrived++];
      index.insert(frame);
      PlaneBox box{frame.footprint[0].x(), frame.footprint[0].y(), frame.footprint[0].x(),
                   frame.footprint[0].y()};
      for (const auto& p : frame.footprint)
        box = {std::min(box.west, p.x()), std::min(box.north, p.y()), std::max(box.east, p.x()),
               std::max(box.south, p.y())};
      scheduler.cover(box);
      for (const TileKey& key : FrameIndex::tilesUnder(frame, kZoom)) {
        seen_s.try_emplace(key, now_s);
        scheduler.mark(key, knowledgeOf(index, key, kGroundM), ns());
      }
      spend(machine.frame_s);
    }
    scheduler.setLanded(arrived == frames.size());
    const auto job = scheduler.next(ns());
    if (!job) {
      if (arrived == frames.size()) break;
      now_s += 0.05;
      continue;
    }
    bool changed = true;
    if (job->kind == Kind::Sweep) {
      auto set = setOf(job->key);
      changed = swept[job->key] != set;
      if (changed) {
        spend(machine.sweep_s);
        ++flown.sweeps;
        swept[job->key] = std::move(set);
        swept_s[job->key] = now_s;
        first_s.try_emplace(job->key, now_s);
      }
    } else if (job->kind == Kind::Finish) {
      spend(machine.finish_s);
      ++flown.finishes;
      finished_s[job->key] = now_s;
    } else {
      spend(machine.parent_s);
    }
    scheduler.done(*job, changed, ns());
  }
  EXPECT_TRUE(scheduler.idle());
  flown.drained_s = now_s - flown.flight_s;
  flown.cells = seen_s.size();
  std::vector<double> waits;
  for (const auto& [key, time_s] : seen_s) {
    flown.final_sets = flown.final_sets && swept[key] == setOf(key);
    if (first_s.contains(key)) waits.push_back(first_s[key] - time_s);
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const auto beside = swept_s.find({key.zoom, key.x + dx, key.y + dy});
        if (beside != swept_s.end()) flown.blended = flown.blended && finished_s[key] > beside->second;
      }
  }
  std::sort(waits.begin(), waits.end());
  flown.first_sweep_s = waits.empty() ? 0 : waits[waits.size() / 2];
  std::printf(
      "%zu cells, %.2f sweeps and %.2f finishes a cell, busy %.0f of %.0f s, %.1f s after the last frame, "
      "first sweep after %.1f s\n",
      flown.cells, static_cast<double>(flown.sweeps) / static_cast<double>(flown.cells),
      static_cast<double>(flown.finishes) / static_cast<double>(flown.cells), flown.busy_s, flown.flight_s,
      flown.drained_s, flown.first_sweep_s);
  return flown;
}

TEST(FlightSchedule, KeepsUpWithAFewSweepsACellAndEndsWhereABatchWould) {
  const Flown flown = fly({}, {});
  EXPECT_TRUE(flown.final_sets);
  EXPECT_TRUE(flown.blended);
  EXPECT_LE(4 * flown.sweeps, 11 * flown.cells);
  EXPECT_LE(2 * flown.finishes, 7 * flown.cells);
  EXPECT_LE(flown.drained_s, 0.2 * flown.flight_s);
  EXPECT_LE(flown.first_sweep_s, 15);
}

// A machine that is far too slow still ends with the same sets, and spends its time on first sweeps.
TEST(FlightSchedule, ASlowMachineSweepsLessOftenAndEndsWithTheSameSets) {
  const Machine slow{1.0, 0.6, 0.6, 0.1};
  const Flown flown = fly({}, slow);
  EXPECT_TRUE(flown.final_sets);
  EXPECT_TRUE(flown.blended);
  EXPECT_LE(flown.sweeps, 2 * flown.cells);
}

// What the rule saves: the thesis' update after every second new frame.
TEST(FlightSchedule, KnowledgeSparesMostOfTheSweepsOfAFixedNumberOfFrames) {
  SchedulerOptions eager;
  eager.first_knowledge = 0;
  eager.growth = 0;
  eager.settle_s = eager.spare_s = eager.max_wait_s = 0;
  const Machine fast{0, 0, 0, 0};
  const Flown by_knowledge = fly({}, fast), by_frames = fly(eager, fast);
  EXPECT_LE(3 * by_knowledge.sweeps, by_frames.sweeps);
}

}  // namespace
}  // namespace overfly::tiling
