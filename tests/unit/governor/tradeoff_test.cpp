#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "daemon/tradeoff/codec_trials.h"
#include "daemon/tradeoff/precision_trials.h"
#include "daemon/tradeoff/report.h"
#include "daemon/tradeoff/svg_chart.h"
#include "daemon/tradeoff/sweep_trials.h"

namespace overfly::tradeoff {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Trial trialOf(double ms, double error, const std::string& setting = "s") {
  Trial trial;
  trial.part = "sweep";
  trial.axis = "a";
  trial.setting = setting;
  trial.processor = timingOf({ms});
  trial.error_name = "error";
  trial.error = error;
  return trial;
}

TEST(Trial, TheFrontIsWhatNoOtherBeats) {
  std::vector<Trial> trials{trialOf(1, 9), trialOf(2, 9), trialOf(3, 4),
                            trialOf(3, 5), trialOf(4, 4), trialOf(9, 1)};
  markFront(trials);
  std::vector<bool> front;
  for (const Trial& trial : trials) front.push_back(trial.on_front);
  EXPECT_EQ(front, (std::vector<bool>{true, false, true, false, false, true}));
}

TEST(Trial, SpreadTellsABusyMachine) {
  EXPECT_FALSE(timingOf({10, 10.5, 10.2}).noisy());
  EXPECT_TRUE(timingOf({10, 14, 10.2}).noisy());
  EXPECT_DOUBLE_EQ(timingOf({3, 1, 2}).median_ms, 2);
}

TEST(SweepSettings, HaveOneDefaultAndDiffer) {
  for (const bool quick : {false, true}) {
    const auto settings = sweepSettings(quick);
    EXPECT_EQ(std::count_if(settings.begin(), settings.end(), [](const auto& s) { return s.is_default; }), 1);
    std::set<std::string> names;
    for (const auto& setting : settings) names.insert(setting.text);
    EXPECT_GE(names.size() + 1, settings.size());  // the default may come again as a combination
  }
}

TEST(Codecs, SimilarityOfAPictureWithItselfIsWhole) {
  std::vector<std::uint8_t> a(4 * 64 * 64, 255), b;
  for (std::size_t i = 0; i < a.size(); i += 4) a[i] = static_cast<std::uint8_t>(i * 37 % 251);
  b = a;
  EXPECT_DOUBLE_EQ(ssim(a, b, 64), 1.0);
  EXPECT_TRUE(std::isinf(psnr(a, b)));
  for (std::size_t i = 0; i < b.size(); i += 4) b[i] = static_cast<std::uint8_t>(b[i] ^ 1);
  EXPECT_NEAR(psnr(a, b), 10 * std::log10(3 * 255.0 * 255.0), 1e-9);  // one of three channels is off by one
  EXPECT_LT(ssim(a, b, 64), 1.0);
}

TEST(Report, IsOneFileThatAsksForNothingElse) {
  Report report{"overfly bench tradeoff",
                {{"device", "a <b>"}},
                {{"flight & co", "truth", {trialOf(1, 2), trialOf(2, 1)}}}};
  report.sections[0].trials[0].is_default = true;
  const std::string html = htmlOf(report);
  EXPECT_THAT(html, HasSubstr("<svg"));
  EXPECT_THAT(html, HasSubstr("a &lt;b&gt;"));
  EXPECT_THAT(html, HasSubstr("prefers-color-scheme: dark"));
  EXPECT_THAT(html, Not(HasSubstr("src=")));
  EXPECT_THAT(html, Not(HasSubstr("http")));
  const auto json = nlohmann::json::parse(jsonOf(report));
  EXPECT_EQ(json["flights"][0]["trials"].size(), 2u);
  std::istringstream lines(csvOf(report));
  std::string line;
  int count = 0;
  while (std::getline(lines, line)) ++count;
  EXPECT_EQ(count, 3);
}

TEST(Precision, OnlyTheTilesOwnFrameKeepsFloat32BelowAHundredthOfAPixel) {
  auto context = gl::Context::create();
  ASSERT_TRUE(context.has_value()) << context.error().message;
  const auto trials = tryPrecision(*context, 1);
  ASSERT_TRUE(trials.has_value()) << trials.error().message;
  const auto errorOf = [&](const std::string& setting) {
    for (const Trial& trial : *trials)
      if (trial.setting == setting) return trial.error;
    return -1.0;
  };
  EXPECT_LT(errorOf("the tile frame's polynomial"), 0.003);
  EXPECT_LT(errorOf("the tile's own frame"), 0.01);
  EXPECT_GT(errorOf("a frame 1000 km away"), 0.5);
  EXPECT_GT(errorOf("ECEF"), 1.0);
}

}  // namespace
}  // namespace overfly::tradeoff
