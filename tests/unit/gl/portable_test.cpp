#include "render/gl/portable.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "render/gl/detail/preprocess.h"
#include "tests/unit/gl/gl_fixture.h"

namespace overfly::gl {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::string> check(Stage stage, std::string_view text, std::vector<Define> defines = {}) {
  const ShaderFile file{"test", text};
  return checkPortable(stage, {&file, 1}, defines);
}

TEST(Portable, WorkGroupsOfMoreThan128AreFound) {
  EXPECT_THAT(check(Stage::Compute, "layout(local_size_x = 16, local_size_y = 8) in;"), IsEmpty());
  EXPECT_THAT(check(Stage::Compute, "layout(local_size_x = 16, local_size_y = 16) in;"),
              ElementsAre(HasSubstr("256 invocations")));
  EXPECT_THAT(
      check(Stage::Compute, "layout(local_size_x = SIDE, local_size_y = SIDE) in;", {{"SIDE", "(2*8)"}}),
      ElementsAre(HasSubstr("256")));
  EXPECT_THAT(check(Stage::Compute, "layout(local_size_x = SIDE) in;"), IsEmpty());
}

TEST(Portable, SharedMemoryBeyond16KbIsFoundThroughConstants) {
  const std::string text =
      "const int kR = 3;\n#define W (LOCAL + 2 * kR)\nshared vec4 a[W * W], b[2];\nshared float c;\n";
  EXPECT_THAT(check(Stage::Compute, text, {{"LOCAL", "8"}}), IsEmpty());  // 196 * 16 + 36
  EXPECT_THAT(check(Stage::Compute, text, {{"LOCAL", "26"}}), ElementsAre(HasSubstr("16420 bytes")));
}

TEST(Portable, SamplersImagesAndStorageAreCountedInTheActiveBranchOnly) {
  const std::string text =
      "#if MODE == 1\nuniform sampler2D one, views[16];\n#else\nuniform highp sampler2D views[8];\n#endif\n";
  EXPECT_THAT(check(Stage::Fragment, text), IsEmpty());
  EXPECT_THAT(check(Stage::Fragment, text, {{"MODE", "1"}}), ElementsAre(HasSubstr("17 samplers")));
  EXPECT_THAT(check(Stage::Compute, "layout(r8, binding = 0) writeonly uniform highp image2D x;"),
              ElementsAre(HasSubstr("format")));
  EXPECT_THAT(check(Stage::Compute, "layout(r32f, binding = 0) uniform readonly highp image2D x;"),
              IsEmpty());
  EXPECT_THAT(check(Stage::Fragment, "layout(r32f, binding = 0) uniform highp image2D x;"),
              ElementsAre(HasSubstr("outside compute")));
  const std::string block = "layout(std430, binding = 0) buffer A { float a[]; };\n";
  EXPECT_THAT(check(Stage::Compute, block), IsEmpty());
  EXPECT_THAT(check(Stage::Fragment, block), ElementsAre(HasSubstr("outside compute")));
  EXPECT_THAT(check(Stage::Compute,
                    "buffer A{float a;};buffer B{float b;};buffer C{float c;};"
                    "buffer D{float d;};buffer E{float e;};"),
              ElementsAre(HasSubstr("5 storage blocks")));
}

TEST(Portable, ExtensionsAndManyTargetsAreFoundCommentsAreNot) {
  EXPECT_THAT(check(Stage::Fragment, "#extension GL_EXT_gpu_shader5 : require\n"),
              ElementsAre(HasSubstr("extension")));
  EXPECT_THAT(check(Stage::Fragment, "// #extension no\n/* uniform sampler2D a[99]; */\n"), IsEmpty());
  EXPECT_THAT(check(Stage::Fragment, "layout(location = 4) out vec4 x;"),
              ElementsAre(HasSubstr("render targets")));
}

TEST(Portable, ExpressionsFollowGlslsPrecedence) {
  const detail::Macros macros{{"A", "4"}, {"B", "A + 1"}};
  EXPECT_EQ(detail::evaluate("2 + 3 * A - 1", macros, false), 13);
  EXPECT_EQ(detail::evaluate("10 - 4 - 3", macros, false), 3);
  EXPECT_EQ(detail::evaluate("B == 5 && !defined(C)", macros, true), 1);
  EXPECT_EQ(detail::evaluate("C", macros, false), std::nullopt);
  EXPECT_EQ(detail::evaluate("1 / 0", macros, false), std::nullopt);
}

// Every shader of the tree, as it stands without defines; variants are checked when a debugging context
// compiles them (see the next test), which all GL tests do.
TEST(Portable, EveryShaderFileKeepsWithinTheMinimum) {
  const std::filesystem::path top(OVERFLY_SOURCE_DIR);
  int seen = 0;
  for (const char* room : {"capture", "render", "tiling", "daemon"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(top / room)) {
      if (entry.path().parent_path().filename() != "shaders") continue;
      const std::string name = std::filesystem::relative(entry.path(), top).string();
      const auto stage = stageOfFile(name);
      if (!stage) continue;
      ++seen;
      std::ifstream in(entry.path());
      std::stringstream text;
      text << in.rdbuf();
      const std::string body = text.str();
      const ShaderFile file{name, body};
      for (const std::string& problem : checkPortable(*stage, {&file, 1})) ADD_FAILURE() << problem;
    }
  }
  EXPECT_GT(seen, 0);
}

using PortableProgram = test::GlTest;

TEST_F(PortableProgram, ADebuggingContextRecordsAVariantBeyondTheMinimum) {
  const ShaderFile file{"wide.comp", "layout(local_size_x = WIDE) in;\nvoid main() {}\n"};
  const Define wide{"WIDE", "256"}, narrow{"WIDE", "128"};
  ASSERT_TRUE(Program::compute(context(), {&file, 1}, {&narrow, 1}).has_value());
  EXPECT_THAT(context().takeErrors(), IsEmpty());
  ASSERT_TRUE(Program::compute(context(), {&file, 1}, {&wide, 1}).has_value());
  EXPECT_THAT(context().takeErrors(), ElementsAre(HasSubstr("wide.comp: a work group has 256 invocations")));
}

}  // namespace
}  // namespace overfly::gl
