#include "daemon/governor/governor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "daemon/tradeoff/sweep_trials.h"
#include "tiling/mapping/mapper_settings.h"

namespace overfly::daemon {
namespace {

using ::testing::HasSubstr;

OperatingPoint pointOf(double time, double nmad, double complete = 1) {
  OperatingPoint point;
  point.name = "p";
  point.relative_time = time;
  point.nmad_gsd = nmad;
  point.complete = complete;
  return point;
}

OperatingTable eightPoints() {
  std::vector<OperatingPoint> points;
  for (int i = 0; i < 8; ++i) points.push_back(pointOf(std::pow(1.6, i - 7), 1.0 * std::pow(0.85, i)));
  return OperatingTable::make(points).value();
}

// A queue of cells that the governed sweep works off, a tenth of a second at a time.
struct Flight {
  const OperatingTable& table;
  Governor governor;
  double device_s;  // true seconds of a cell at the most accurate point
  double waiting = 0, due = 0, now_s = 0, worst_wait_s = 0;
  std::vector<std::size_t> points;  // one per step

  Flight(const OperatingTable& t, const GovernorOptions& options, double device)
      : table(t), governor(t, options), device_s(device) {}

  void fly(double seconds, const std::function<double(double)>& cells_per_s, double headroom = 1) {
    constexpr double kStep = 0.1;
    double work_s = 0;
    for (double t = 0; t < seconds; t += kStep, now_s += kStep) {
      const double fresh = cells_per_s(t) * kStep;
      waiting += fresh;
      due += fresh;
      const std::size_t point = governor.decide({now_s, waiting, static_cast<std::uint64_t>(due), headroom});
      points.push_back(point);
      const double cell_s = device_s * table[point].relative_time / headroom;
      worst_wait_s = std::max(worst_wait_s, waiting * cell_s);
      work_s = waiting > 0 ? work_s + kStep : 0;
      while (waiting > 0 && work_s >= cell_s) {
        work_s -= cell_s;
        waiting = std::max(0.0, waiting - 1);
        governor.swept(point, cell_s * headroom);
      }
    }
  }
  // Changes of direction: down after up, up after down.
  [[nodiscard]] int reversals(std::size_t from = 0) const {
    int count = 0, last = 0;
    for (std::size_t i = std::max<std::size_t>(from, 1); i < points.size(); ++i) {
      const int step = points[i] > points[i - 1] ? 1 : points[i] < points[i - 1] ? -1 : 0;
      if (step == 0) continue;
      if (last != 0 && step != last) ++count;
      last = step;
    }
    return count;
  }
};

RC_GTEST_PROP(OperatingTable, KeepsOnlyWhatNoOtherPointBeats, ()) {
  const auto raw = *rc::gen::nonEmpty(rc::gen::container<std::vector<std::pair<int, int>>>(
      rc::gen::pair(rc::gen::inRange(1, 50), rc::gen::inRange(1, 50))));
  std::vector<OperatingPoint> points;
  for (const auto& [time, error] : raw) points.push_back(pointOf(time, error));
  const auto table = OperatingTable::make(points);
  RC_ASSERT(table.has_value());
  for (std::size_t i = 0; i < table->size(); ++i)
    for (const OperatingPoint& other : points)
      RC_ASSERT(!(other.relative_time <= (*table)[i].relative_time && other.error() <= (*table)[i].error() &&
                  (other.relative_time < (*table)[i].relative_time || other.error() < (*table)[i].error())));
}

TEST(OperatingTable, LeavingPlacesEmptyIsNotAccuracy) {
  const auto table = OperatingTable::make({pointOf(1, 0.3, 0.5), pointOf(2, 0.4, 1.0)}).value();
  EXPECT_EQ(table.size(), 2u);
  EXPECT_GT(table[0].error(), table[1].error());
}

TEST(OperatingTable, TextReadsBackTheSame) {
  const OperatingTable table = eightPoints();
  const auto again = OperatingTable::parse(table.json());
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(again->json(), table.json());
}

TEST(OperatingTable, BadTextIsRefusedWithTheReason) {
  EXPECT_THAT(OperatingTable::parse("[]").error().message, HasSubstr("points"));
  EXPECT_THAT(OperatingTable::parse("{\"points\": [{\"name\": \"a\"}]}").error().message,
              HasSubstr("images"));
  EXPECT_FALSE(OperatingTable::parse("{\"points\": []}").has_value());
  EXPECT_FALSE(OperatingTable::make({pointOf(0, 1)}).has_value());
  EXPECT_FALSE(OperatingTable::make({pointOf(1, std::nan(""))}).has_value());
}

TEST(Governor, TakesTheBestPointWhileThereIsTime) {
  const OperatingTable table = eightPoints();
  Flight flight(table, {}, 0.5);
  flight.fly(120, [](double) { return 1.0; });
  EXPECT_EQ(flight.points.back(), table.size() - 1);
  EXPECT_EQ(flight.governor.changes(), 0u);
}

TEST(Governor, AStepInLoadIsOneMoveDown) {
  const OperatingTable table = eightPoints();
  Flight flight(table, {.latency_s = 10}, 0.5);
  flight.fly(60, [](double) { return 1.0; });
  flight.fly(400, [](double) { return 8.0; });
  EXPECT_LT(flight.points.back(), table.size() - 1);
  EXPECT_LE(flight.worst_wait_s, 25);
  EXPECT_LE(flight.reversals(), 3);
  // It has settled: at most one look upwards in the last three minutes.
  EXPECT_LE(flight.reversals(flight.points.size() - 1800), 2);
  const double keeps_up = 8.0 * 0.5 * table[flight.points.back()].relative_time;
  EXPECT_LE(keeps_up, 1.0);
}

TEST(Governor, ARampGoesDownStepByStepAndComesBack) {
  const OperatingTable table = eightPoints();
  Flight flight(table, {.latency_s = 10}, 0.4);
  flight.fly(200, [](double t) { return 1.0 + t / 20; });
  EXPECT_LE(flight.reversals(), 2);
  flight.fly(600, [](double) { return 0.5; });
  EXPECT_EQ(flight.points.back(), table.size() - 1);
}

TEST(Governor, BurstsDoNotMakeItSwing) {
  const OperatingTable table = eightPoints();
  Flight flight(table, {.latency_s = 15}, 0.4);
  flight.fly(900, [](double t) { return std::fmod(t, 20) < 2 ? 12.0 : 0.3; });
  EXPECT_LE(flight.reversals(), 6) << flight.governor.changes() << " changes";
}

RC_GTEST_PROP(Governor, AnyLoadKeepsItOnTheFrontAndCalm, ()) {
  const OperatingTable table = eightPoints();
  const double device = *rc::gen::inRange(1, 20) / 10.0;
  Flight flight(table, {.latency_s = 10}, device);
  const int phases = *rc::gen::inRange(1, 5);
  for (int i = 0; i < phases; ++i) {
    const double rate = *rc::gen::inRange(0, 60) / 10.0;
    const std::size_t from = flight.points.size();
    flight.fly(300, [rate](double) { return rate; });
    for (const std::size_t point : flight.points) RC_ASSERT(point < table.size());
    // Under a steady load: it finds its place, and tries the next better one ever more rarely.
    RC_ASSERT(flight.reversals(from) <= 7);
  }
}

TEST(Governor, ThrottlingCountsAsASlowerDevice) {
  const OperatingTable table = eightPoints();
  Flight flight(table, {.latency_s = 5}, 0.5);
  flight.fly(60, [](double) { return 1.6; });
  EXPECT_EQ(flight.points.back(), table.size() - 1);
  flight.fly(
      120, [](double) { return 1.6; }, 0.4);
  EXPECT_LT(flight.points.back(), table.size() - 1);
}

TEST(Governor, ASlowStartIsNoLoad) {
  const OperatingTable table = eightPoints();
  Governor governor(table, {.latency_s = 15});
  governor.tookFrames(6);  // the map's ground, shaders
  for (int cell = 0; cell < 100; ++cell) {
    EXPECT_EQ(governor.decide({8 + 0.2 * cell, 30, static_cast<std::uint64_t>(30 + cell)}), governor.best());
    governor.swept(governor.point(), cell == 0 ? 2.0 : 0.1);
    governor.alsoSpent(0.1);
  }
  EXPECT_NEAR(governor.secondsPerCell(governor.best()), 0.2, 0.01);
}

TEST(Governor, WhatTheAimAllowsIsSweptAtTheBestPointHoweverTheQueueGrows) {
  const OperatingTable table = eightPoints();
  Flight flight(table, {.latency_s = 15}, 0.4);
  flight.fly(60, [](double) { return 2.9; });  // 1.16 times what it can do: 9.6 s of work left in the end
  EXPECT_EQ(flight.governor.changes(), 0u);
  EXPECT_LE(flight.worst_wait_s, 15);
}

TEST(Governor, AfterTheLastFrameWhatTakesAMinuteIsSweptOnce) {
  const OperatingTable table = eightPoints();
  for (const auto& [waiting, in_one_go] : {std::pair{100.0, true}, std::pair{1000.0, false}}) {
    Governor governor(table, {.latency_s = 5}, 0.5);
    for (int cell = 0; cell < 20; ++cell) governor.swept(governor.best(), 0.5);
    EXPECT_EQ(governor.decide({0, 0, 0, 1, false}), governor.best());
    EXPECT_LT(governor.decide({10, waiting, 100, 1, false}), governor.best());
    for (double left = waiting; left > 0; left -= 10)
      EXPECT_EQ(governor.decide({20 + waiting - left, left, 100, 1, true}) == governor.best(),
                in_one_go || left * governor.secondsPerCell(governor.best()) < 60)
          << left << " of " << waiting;
  }
}

TEST(Governor, AnExplicitTimePerTileIsNeverExceeded) {
  const OperatingTable table = eightPoints();
  GovernorOptions options;
  options.s_per_cell = 0.2;
  Governor governor(table, options, 0.5);
  for (int i = 0; i < 1000; ++i) {
    const std::size_t point = governor.decide({0.1 * i, 0, 0});
    EXPECT_LE(governor.secondsPerCell(point), 0.2);
  }
}

TEST(Governor, BestWaitsForAccuracyAtAnyLag) {
  const OperatingTable table = eightPoints();
  Flight flight(table, governorOptions({.mode = config::QualityMode::Best}), 2);
  flight.fly(200, [](double) { return 5.0; });
  EXPECT_EQ(flight.governor.changes(), 0u);
}

TEST(Governor, LearnsTheDevicesSpeed) {
  const OperatingTable table = eightPoints();
  Governor governor(table, {});
  for (int i = 0; i < 100; ++i) governor.swept(3, 0.7 * table[3].relative_time);
  EXPECT_NEAR(governor.deviceSeconds(), 0.7, 1e-6);
}

TEST(Governor, OtherWorkOfACellCountsAtEveryPoint) {
  const OperatingTable table = eightPoints();
  Governor governor(table, {});
  for (int i = 0; i < 400; ++i) {  // in bursts of ten cells, as batches come
    if (i % 10 == 0) governor.alsoSpent(2.0);
    governor.swept(7, 0.5);
  }
  EXPECT_NEAR(governor.secondsPerCell(7), 0.7, 0.04);
  EXPECT_NEAR(governor.secondsPerCell(0), 0.5 * table[0].relative_time + 0.2, 0.04);
}

// Whoever asks for a small window or few images in the settings never gets more of them.
TEST(OperatingPoint, TakesTheCheaperOfItselfAndTheSettings) {
  OperatingPoint point = pointOf(0.5, 1);
  point.images = 8;
  point.finest_level = 1;
  point.window_radius = 3;
  point.two_surfaces = false;
  tiling::SweepOptions settings;
  settings.max_views = 5;
  settings.window_radius = 4;
  settings.max_planes = 77;
  const tiling::SweepOptions applied = point.applied(settings);
  EXPECT_EQ(applied.max_views, 5);
  EXPECT_EQ(applied.window_radius, 3);
  EXPECT_EQ(applied.finest_level, 1);
  EXPECT_EQ(applied.max_planes, 77);
  EXPECT_FALSE(applied.two_surfaces);
}

// What the settings say is the last point whatever it was measured to give; dearer ones go.
TEST(OperatingTable, EndsWithWhatTheSettingsSay) {
  OperatingPoint as_set = pointOf(0.5, 0.40);
  as_set.as_set = true;
  const OperatingTable table = OperatingTable::make({pointOf(0.9, 0.1), as_set, pointOf(0.3, 0.38),
                                                     pointOf(0.1, 0.8), pointOf(0.2, 0.9)})
                                   .value();
  ASSERT_EQ(table.size(), 3u);
  EXPECT_EQ(table[0].relative_time, 0.1);
  EXPECT_EQ(table[1].relative_time, 0.3);
  EXPECT_TRUE(table[2].as_set);
  const OperatingTable again = OperatingTable::parse(table.json()).value();
  EXPECT_TRUE(again[2].as_set);
}

TEST(SweepTrials, SeveralFlightsMakeOneTable) {
  const auto one = tradeoff::combined({{pointOf(0.1, 1.0, 0.9)}, {pointOf(0.4, 3.0, 0.7)}});
  ASSERT_EQ(one.size(), 1u);
  EXPECT_NEAR(one[0].relative_time, 0.2, 1e-12);
  EXPECT_NEAR(one[0].nmad_gsd, 2.0, 1e-12);
  EXPECT_NEAR(one[0].complete, 0.8, 1e-12);
}

// The table that the program brings along ends with what maps are made with by default.
TEST(OperatingTable, ShippedEndsWithTheDefaultSettings) {
  const OperatingTable& table = OperatingTable::shipped();
  ASSERT_GE(table.size(), 4u);
  const tiling::SweepOptions defaults = tiling::mapperOptions({}).sweep;
  EXPECT_EQ(table[table.size() - 1].applied(defaults), defaults);
  EXPECT_NE(table[table.size() - 2].applied(defaults), defaults);
}

}  // namespace
}  // namespace overfly::daemon
