#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cctype>
#include <regex>
#include <set>

#include "config/description.h"
#include "config/detail/check.h"
#include "config/load.h"
#include "config/sample.h"

namespace overfly::config {
namespace {

// A key's default must itself be a value that the loader would take.
TEST(Description, EveryDefaultIsAllowed) {
  for (const SectionInfo& section : description()) {
    for (const Key& key : section.keys) {
      const auto loaded =
          loadText("[" + section.name + "]\n" + key.name + " = " + tomlText(key.get(Settings{})), "f");
      EXPECT_TRUE(loaded) << errorFrom(loaded.error()).message;
    }
  }
}

TEST(Description, NamesAreUniqueAndCanBeWrittenAsEnvironmentVariables) {
  std::set<std::string> seen;
  for (const SectionInfo& section : description()) {
    EXPECT_TRUE(std::regex_match(section.name, std::regex("[a-z][a-z0-9]*"))) << section.name;
    for (const Key& key : section.keys) {
      EXPECT_TRUE(std::regex_match(key.name, std::regex("[a-z][a-z0-9_]*"))) << key.path();
      EXPECT_TRUE(seen.insert(key.path()).second) << key.path() << " twice";
      EXPECT_FALSE(key.help.empty()) << key.path();
      EXPECT_NE(key.help.back(), '.') << key.path();
    }
  }
}

// A field that two keys write, or none, is a mistake in the table that no other test would see.
TEST(Description, SettingOneKeyChangesThatKeyAlone) {
  for (const SectionInfo& section : description()) {
    for (const Key& key : section.keys) {
      Settings changed;
      Value other = key.get(changed);
      if (auto* b = std::get_if<bool>(&other)) *b = !*b;
      if (auto* i = std::get_if<std::int64_t>(&other)) *i += 1;
      if (auto* d = std::get_if<double>(&other)) *d += 0.125;
      if (auto* t = std::get_if<std::string>(&other)) {
        *t = key.kind != Kind::Choice ? *t + "x" : *t == key.choices[0] ? key.choices[1] : key.choices[0];
      }
      if (auto* v = std::get_if<std::vector<double>>(&other)) (*v)[2] += 0.125;
      if (auto* l = std::get_if<std::vector<std::string>>(&other)) l->push_back("x");
      key.set(changed, other);
      EXPECT_THAT(differences(Settings{}, changed), testing::ElementsAre(&key)) << key.path();
    }
  }
}

TEST(Description, UnitsComeFromTheName) {
  EXPECT_EQ(unitInWords("max_gap_ms"), "milliseconds");
  EXPECT_EQ(unitInWords("gsd_m"), "metres");
  EXPECT_EQ(unitInWords("max_kbps"), "kilobits per second");
  EXPECT_EQ(unitInWords("max_updates_per_s"), "per second");
  EXPECT_EQ(unitInWords("items"), "");
  EXPECT_EQ(unitInWords("ms"), "");
}

TEST(Sample, OfTheDefaultsReadsBackAsTheDefaultsWithItsLinesInForceToo) {
  const std::string sample = sampleText(Settings{});
  const auto as_is = loadText(sample, "sample.toml");
  ASSERT_TRUE(as_is) << errorFrom(as_is.error()).message;
  EXPECT_TRUE(as_is->origins.empty());

  const std::string in_force = std::regex_replace(sample, std::regex("(^|\n)#([a-z])"), "$1$2");
  const auto loaded = loadText(in_force, "sample.toml");
  ASSERT_TRUE(loaded) << errorFrom(loaded.error()).message;
  EXPECT_TRUE(differences(Settings{}, loaded->settings).empty());
  std::size_t keys = 0;
  for (const SectionInfo& section : description()) keys += section.keys.size();
  EXPECT_EQ(loaded->origins.size(), keys) << "a key is missing in the sample";
}

TEST(Sample, OfChangedSettingsReadsBackAsThese) {
  Settings changed;
  changed.source.path = "/tmp/a \"quoted\" \\ path\twith ü";
  changed.pose.lever_arm_m = {0.1, -0.2, 1e-9};
  changed.link.allowed_origins = {"https://a.example", "https://b.example"};
  changed.sweep.cost = MatchingCost::Census;
  changed.map.tile_size = 512;
  const auto loaded = loadText(sampleText(changed), "sample.toml");
  ASSERT_TRUE(loaded) << errorFrom(loaded.error()).message;
  EXPECT_TRUE(differences(changed, loaded->settings).empty());
  EXPECT_EQ(loaded->origins.size(), 5U);
}

}  // namespace
}  // namespace overfly::config
