#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "daemon/cli/progress.h"

namespace overfly::cli {
namespace {

// What a Progress writes while `done` runs from 1 to `steps`.
std::string written(std::uint64_t total, std::uint64_t steps, bool terminal) {
  char* buffer = nullptr;
  std::size_t size = 0;
  std::FILE* out = open_memstream(&buffer, &size);
  {
    Progress progress("working", total, out, terminal);
    for (std::uint64_t i = 1; i <= steps; ++i) progress.update(i, "file" + std::to_string(i));
  }
  std::fclose(out);
  std::string text(buffer, size);
  std::free(buffer);
  return text;
}

TEST(Progress, LogGetsTenPlainLinesAndNoControlCharacters) {
  const std::string text = written(1000, 1000, false);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 10);
  EXPECT_EQ(text.find('\r'), std::string::npos);
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
  EXPECT_NE(text.find("working: 1000 of 1000 (100 %)  file1000\n"), std::string::npos) << text;
}

TEST(Progress, FewStepsGiveALineEachAndNeverMoreThanTheTotal) {
  const std::string text = written(3, 5, false);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 3) << text;
  EXPECT_EQ(text.find("5 of 3"), std::string::npos);
}

TEST(Progress, UnknownTotalCountsInDecades) {
  EXPECT_EQ(written(0, 150, false), "working: 1  file1\nworking: 10  file10\nworking: 100  file100\n");
}

TEST(Progress, ShortWorkOnATerminalLeavesNoTrace) { EXPECT_EQ(written(10, 10, true), ""); }

}  // namespace
}  // namespace overfly::cli
