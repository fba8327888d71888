#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "config/description.h"

namespace overfly::cli {
namespace {

const std::string kProgram = std::string(OVERFLY_BINARY_DIR) + "/bin/overfly";

struct Output {
  int status = -1;
  std::string text;
};

Output run(const std::string& command) {
  Output out;
  std::FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  std::array<char, 4096> block{};
  while (const auto size = std::fread(block.data(), 1, block.size(), pipe))
    out.text.append(block.data(), size);
  out.status = pclose(pipe);
  return out;
}

// A page as a reader sees it, on one very long line a paragraph, without marks of bold and italic.
std::string rendered(const std::string& page) {
  return run(kProgram + " manual " + page + " | GROFF_NO_SGR=1 groff -man -Tutf8 -rLL=2000n -P-cbou").text;
}

// The names in the list of commands that --help prints.
std::vector<std::string> commandsOf(const std::string& command) {
  std::vector<std::string> out;
  std::istringstream in(run(kProgram + " " + command + " --help").text);
  bool listed = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("Subcommands:")) {
      listed = true;
    } else if (listed && line.size() > 2 && line.starts_with("  ") && line[2] != ' ') {
      out.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  return out;
}

class Manual : public testing::Test {
 protected:
  void SetUp() override {
    if (run("groff --version").status != 0) GTEST_SKIP() << "groff is not installed";
  }
};

TEST_F(Manual, PagesRenderWithoutAWarning) {
  for (const auto* page : {"overfly", "overflyd", "overfly.toml"}) {
    const auto told = run(kProgram + " manual " + page + " | groff -man -ww -z -Tutf8");
    EXPECT_EQ(told.status, 0) << page;
    EXPECT_EQ(told.text, "") << page;
  }
}

TEST_F(Manual, EveryCommandAndSubcommandIsThere) {
  const auto page = rendered("overfly");
  const auto commands = commandsOf("");
  ASSERT_GT(commands.size(), 8u);
  for (const auto& command : commands) {
    EXPECT_NE(page.find("overfly " + command), std::string::npos) << command;
    for (const auto& one : commandsOf(command))
      EXPECT_NE(page.find("overfly " + command + " " + one), std::string::npos) << command << " " << one;
  }
}

TEST_F(Manual, EverySettingIsThereWithWhatItTakes) {
  const auto page = rendered("overfly.toml");
  for (const auto& section : config::description()) {
    EXPECT_NE(page.find("[" + section.name + "]"), std::string::npos) << section.name;
    for (const auto& key : section.keys) {
      EXPECT_NE(page.find(" " + key.name), std::string::npos) << key.path();
      EXPECT_NE(page.find(config::allowed(key)), std::string::npos) << key.path();
    }
  }
}

class Completion : public testing::Test {
 protected:
  // What bash offers for the last of the words.
  static std::vector<std::string> offered(const std::string& words, const std::string& program = "overfly") {
    const auto script =
        std::filesystem::temp_directory_path() / ("overfly-completion-" + std::to_string(getpid()));
    std::ofstream(script) << run(kProgram + " manual bash").text << "COMP_WORDS=(" << program << " " << words
                          << ")\nCOMP_CWORD=$((${#COMP_WORDS[@]} - 1))\ncompopt() { :; }\n_" << program
                          << "\nprintf '%s\\n' \"${COMPREPLY[@]}\"\n";
    const auto output = run("bash " + script.string());
    std::filesystem::remove(script);
    EXPECT_EQ(output.status, 0) << output.text;
    std::vector<std::string> out;
    std::istringstream in(output.text);
    for (std::string line; std::getline(in, line);) out.push_back(line);
    return out;
  }
  static bool has(const std::vector<std::string>& all, const std::string& one) {
    return std::find(all.begin(), all.end(), one) != all.end();
  }
};

TEST_F(Completion, BashOffersCommandsOptionsValuesAndSettings) {
  for (const auto& command : commandsOf("")) EXPECT_TRUE(has(offered("''"), command)) << command;
  EXPECT_EQ(offered("pul"), std::vector<std::string>{"pull"});
  EXPECT_TRUE(has(offered("flight ''"), "info"));
  EXPECT_TRUE(has(offered("pull --on"), "--once"));
  EXPECT_TRUE(has(offered("pull --js"), "--json"));
  EXPECT_TRUE(has(offered("export --layer el"), "elevation"));
  EXPECT_TRUE(has(offered("--set link.po"), "link.port="));
  EXPECT_TRUE(has(offered("--exit", "overflyd"), "--exit-when-done"));
}

TEST_F(Completion, ZshReadsItsScript) {
  if (run("zsh --version").status != 0) GTEST_SKIP() << "zsh is not installed";
  const auto told = run("bash -c '" + kProgram + " manual zsh | zsh -n'");
  EXPECT_EQ(told.status, 0);
  EXPECT_EQ(told.text, "");
}

}  // namespace
}  // namespace overfly::cli
