#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <functional>

#include "config/description.h"
#include "config/detail/nearest.h"
#include "config/load.h"

namespace overfly::config {
namespace {

const Key& anyKey(const std::function<bool(const Key&)>& wanted) {
  std::vector<const Key*> keys;
  for (const SectionInfo& section : description()) {
    for (const Key& key : section.keys) {
      if (wanted(key)) keys.push_back(&key);
    }
  }
  return **rc::gen::elementOf(keys);
}

// Keys that ask something of other keys: their value alone does not decide whether it is taken.
bool standsAlone(const Key& key) {
  return key.path() != "sweep.prefer" && !key.name.starts_with("tls_") &&
         key.name.find("parallax") == std::string::npos;
}

double within(const Key& key) {
  const double share = *rc::gen::inRange(0, 1000001) / 1e6;
  return key.min + share * (key.max - key.min);
}

// Some value that the key must take; texts with a pattern keep their default.
Value anyValue(const Key& key) {
  switch (key.kind) {
    case Kind::Bool:
      return *rc::gen::arbitrary<bool>();
    case Kind::Int:
      if (!key.choices.empty()) return std::int64_t{std::stoll(*rc::gen::elementOf(key.choices))};
      return static_cast<std::int64_t>(within(key));
    case Kind::Double:
      return within(key);
    case Kind::Text:
    case Kind::Path:
      if (!key.pattern.empty()) return key.get(Settings{});
      return *rc::gen::container<std::string>(rc::gen::inRange<char>(1, 127));
    case Kind::Choice:
      return *rc::gen::elementOf(key.choices);
    case Kind::TextList:
      return *rc::gen::container<std::vector<std::string>>(
          rc::gen::container<std::string>(rc::gen::inRange<char>(1, 127)));
    case Kind::Vector3:
      return std::vector<double>{within(key), within(key), within(key)};
  }
  return false;
}

RC_GTEST_PROP(SettingsProperty, AnyAllowedValueSurvivesTheFile, ()) {
  const Key& key = anyKey(standsAlone);
  const Value value = anyValue(key);
  const auto loaded = loadText("[" + key.section + "]\n" + key.name + " = " + tomlText(value), "f");
  if (!loaded) RC_FAIL(errorFrom(loaded.error()).message);
  RC_ASSERT(key.get(loaded->settings) == value);
}

RC_GTEST_PROP(SettingsProperty, ANumberOutsideItsRangeNeverPasses, ()) {
  const Key& key = anyKey([](const Key& k) { return k.kind == Kind::Int || k.kind == Kind::Double; });
  const double beyond = 1 + *rc::gen::inRange(0, 1000000);
  const double number = *rc::gen::arbitrary<bool>() ? key.max + beyond : key.min - beyond;
  const Value value = key.kind == Kind::Int ? Value(static_cast<std::int64_t>(number)) : Value(number);
  const auto loaded = loadText("[" + key.section + "]\n" + key.name + " = " + tomlText(value), "f");
  RC_ASSERT(!loaded);
  RC_ASSERT(loaded.error().size() == 1U);
  RC_ASSERT(loaded.error()[0].origin.line == 2);
  RC_ASSERT(loaded.error()[0].key == key.path());
}

// One slip of the finger: the message must name a key that exists, and mostly the one that was meant.
RC_GTEST_PROP(SettingsProperty, AKeyWithOneTypoIsNeverTakenAndHasASuggestion, ()) {
  const Key& key = anyKey([](const Key& k) { return k.name.size() >= 4; });
  std::string typo = key.name;
  const auto at = *rc::gen::inRange<std::size_t>(0, typo.size());
  switch (*rc::gen::inRange(0, 3)) {
    case 0:
      typo[at] = 'q';
      break;
    case 1:
      typo.erase(at, 1);
      break;
    default:
      typo.insert(at, 1, 'q');
  }
  // As a bool: RapidCheck cannot print a null pointer.
  const bool is_no_key = findKey(key.section, typo) == nullptr;
  RC_PRE(is_no_key);
  const auto loaded = loadText("[" + key.section + "]\n" + typo + " = 1", "f");
  RC_ASSERT(!loaded);
  RC_ASSERT(loaded.error()[0].message.find("did you mean " + key.section + ".") != std::string::npos);
}

// The text comes from anywhere: no crash, and every problem has a line within the text.
RC_GTEST_PROP(SettingsProperty, ArbitraryTextEndsInSettingsOrProblems, ()) {
  const auto text =
      *rc::gen::container<std::string>(rc::gen::elementOf(std::string("[]=\"\n\n#.'{},-1aswep \t\\")));
  const auto loaded = loadText("[sweep]\n" + text, "f");
  if (loaded) return;
  const auto lines = 2 + std::count(text.begin(), text.end(), '\n');
  RC_ASSERT(!loaded.error().empty());
  for (const Problem& problem : loaded.error()) {
    RC_ASSERT(problem.origin.line >= 1);
    RC_ASSERT(problem.origin.line <= lines);
  }
}

RC_GTEST_PROP(EditDistance, IsAMetricOfItsArguments, (const std::string& a, const std::string& b)) {
  using detail::editDistance;
  RC_ASSERT(editDistance(a, a) == 0U);
  RC_ASSERT(editDistance(a, b) == editDistance(b, a));
  RC_ASSERT(editDistance(a, b) <= std::max(a.size(), b.size()));
  RC_ASSERT(editDistance(a, "") == a.size());
}

TEST(EditDistance, KnownPairs) {
  using detail::editDistance;
  EXPECT_EQ(editDistance("planes", "plane"), 1U);
  EXPECT_EQ(editDistance("plnaes", "planes"), 1U);  // neighbours swapped
  EXPECT_EQ(editDistance("kitten", "sitting"), 3U);
}

}  // namespace
}  // namespace overfly::config
