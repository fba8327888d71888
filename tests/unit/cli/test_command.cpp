#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

namespace {

using testing::HasSubstr;
using testing::IsEmpty;

struct Outcome {
  int status = -1;
  std::string out;
  std::string err;
};

// Runs the built program through the shell.
Outcome overfly(const std::string& arguments, const std::string& before = "") {
  std::string error_file = (std::filesystem::temp_directory_path() / "overfly_cli_XXXXXX").string();
  const int descriptor = mkstemp(error_file.data());
  EXPECT_NE(descriptor, -1);
  close(descriptor);
  const std::string command =
      before + " " OVERFLY_BINARY_DIR "/bin/overfly " + arguments + " 2>" + error_file;
  std::FILE* pipe = popen(command.c_str(), "r");
  EXPECT_NE(pipe, nullptr);
  Outcome outcome;
  std::array<char, 4096> buffer{};
  while (const std::size_t size = std::fread(buffer.data(), 1, buffer.size(), pipe))
    outcome.out.append(buffer.data(), size);
  outcome.status = WEXITSTATUS(pclose(pipe));
  std::ifstream errors(error_file);
  outcome.err.assign(std::istreambuf_iterator<char>(errors), {});
  std::filesystem::remove(error_file);
  return outcome;
}

TEST(Command, HelpAndVersionEndWellOnStdout) {
  const Outcome help = overfly("--help");
  EXPECT_EQ(help.status, 0);
  EXPECT_THAT(help.out, HasSubstr("config"));
  EXPECT_THAT(help.err, IsEmpty());
  EXPECT_THAT(overfly("--version").out, HasSubstr("overfly "));
  EXPECT_EQ(overfly("config check --help").status, 0);
}

TEST(Command, BadUsageIsOneSentenceAndStatusTwo) {
  for (const char* arguments :
       {"", "nonsense", "config", "config check", "config print --nonsense", "--set"}) {
    const Outcome outcome = overfly(arguments);
    EXPECT_EQ(outcome.status, 2) << arguments;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("overfly: ")) << arguments;
    EXPECT_THAT(outcome.out, IsEmpty()) << arguments;
  }
}

TEST(Command, BadSettingsAreStatusTwo) {
  const Outcome outcome = overfly("config print --set sweep.planes=1");
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.err, HasSubstr("overfly: --set sweep.planes=1: sweep.planes: found 1"));
  EXPECT_THAT(outcome.out, IsEmpty());
}

TEST(Command, GlobalOptionsMayStandAnywhere) {
  for (const char* arguments : {"--set log.level=debug --set gpu.frame_cache_mb=64 config print",
                                "config --set log.level=debug print --set gpu.frame_cache_mb=64"}) {
    const Outcome outcome = overfly(arguments);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_THAT(outcome.out, HasSubstr("\nlevel = \"debug\"\n"));
    EXPECT_THAT(outcome.out, HasSubstr("\nframe_cache_mb = 64\n"));
  }
}

TEST(Command, EnvironmentReachesTheSettings) {
  EXPECT_THAT(overfly("config print --json", "OVERFLY_GPU_FRAME_CACHE_MB=77").out,
              HasSubstr("\"frame_cache_mb\": 77"));
}

TEST(Command, AFullDiskIsAFailureNotASuccess) {
  EXPECT_EQ(overfly("config print --defaults >/dev/full").status, 1);
}

TEST(Command, CheckTakesThePrintedSampleAndRefusesABrokenOne) {
  const std::string file =
      (std::filesystem::temp_directory_path() / ("overfly_sample_" + std::to_string(getpid()))).string();
  ASSERT_EQ(overfly("config print --defaults >" + file).status, 0);
  EXPECT_EQ(overfly("config check " + file).status, 0);
  std::ofstream(file) << "[sweep]\nplane = 3\nimages = 1\n";
  const Outcome broken = overfly("config check " + file);
  EXPECT_EQ(broken.status, 2);
  EXPECT_THAT(broken.err, HasSubstr(file + ":2: sweep.plane: no such key; did you mean sweep.planes?\n"));
  EXPECT_THAT(broken.err, HasSubstr(file + ":3: sweep.images: found 1"));
  EXPECT_EQ(overfly("config check " + file + " --json").status, 2);
  std::filesystem::remove(file);
  EXPECT_EQ(overfly("config check " + file).status, 2);
}

}  // namespace
