#include "tests/stress/hard_case/hard_case.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace overfly::test {
namespace {

namespace fs = std::filesystem;

bool holds(const HardCase& c) {
  return c.must == HardCase::Must::BeAtMost ? c.measured <= c.bound : c.measured >= c.bound;
}

void write(const HardCase& c, const char* verdict) {
  const std::string line = fmt::format("{:<12} {:<34} {:>12.6g} {} {:<10.6g} {}", verdict, c.id, c.measured,
                                       c.must == HardCase::Must::BeAtMost ? "<=" : ">=", c.bound, c.what);
  std::printf("%s\n", line.c_str());
  const fs::path folder = fs::path(OVERFLY_BINARY_DIR) / "hard-cases";
  std::error_code ignored;
  fs::create_directories(folder, ignored);
  std::string name = c.id + " " + c.what;
  std::replace_if(
      name.begin(), name.end(), [](unsigned char ch) { return std::isalnum(ch) == 0; }, '_');
  std::ofstream(folder / (name.substr(0, 120) + ".txt")) << line << '\n';

  std::ifstream page(fs::path(OVERFLY_SOURCE_DIR) / "docs/hard-cases.md");
  const std::string text{std::istreambuf_iterator<char>(page), {}};
  EXPECT_NE(text.find("| `" + c.id + "` |"), std::string::npos)
      << c.id << " has no row in docs/hard-cases.md";
}

}  // namespace

void expectHolds(const HardCase& c) {
  const bool good = holds(c);
  write(c, good ? "holds" : "FAILS");
  EXPECT_TRUE(good) << c.id << ": " << c.what << " is " << c.measured << ", bound " << c.bound;
}

void expectKnownLimit(const HardCase& c) {
  const bool good = holds(c);
  write(c, good ? "HOLDS NOW" : "not held");
  EXPECT_FALSE(good) << c.id << ": " << c.what << " holds now: make it a bound, and mend docs/hard-cases.md";
}

}  // namespace overfly::test
