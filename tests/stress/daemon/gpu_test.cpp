#include <gtest/gtest.h>

#include <string>

#include "render/gl/program.h"
#include "tests/integration/daemon/daemon_process.h"
#include "tests/integration/daemon/pipeline_fixture.h"
#include "tests/stress/hard_case/hard_case.h"

// A GPU that fails in the middle of a sweep, of an orthophoto, of a frame: the work is done again, and the
// map is that of a GPU that did not, byte for byte.
namespace overfly::test {
namespace {

using daemon::Pipeline;
using daemon::PipelineStatus;

class Gpu : public ::testing::Test {
 protected:
  void SetUp() override {
    if (smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  }

  // Maps the smoke flight with the fault; the row says how many of the map's coded layers are other ones.
  PipelineStatus survives(const std::string& id, const std::string& what, const char* fault) {
    const PipelineFolder folder;
    Pipeline pipeline(settingsHere(), smokeSource(0), folder.path, *gl_);
    pipeline.setGpuHook(*daemon::parseGpuHook(fault));
    EXPECT_TRUE(pipeline.start());
    EXPECT_TRUE(waitUntilMapped(pipeline)) << pipeline.status().error;
    const PipelineStatus status = pipeline.status();
    pipeline.stop();
    EXPECT_EQ(status.mapped, kSmokeFrames);
    EXPECT_TRUE(status.refused.empty());
    expectAtMost(id, what + ": layers that differ",
                 static_cast<double>(layersUnlikeAllFramesAtOnce(pipeline.mapFile(), settingsHere(), *gl_)),
                 0);
    return status;
  }

  const std::unique_ptr<gl::GlThread> gl_ = glThread();
};

TEST_F(Gpu, LostAgainAndAgain) {
  const std::uint64_t generation = gl_->generation();
  const PipelineStatus status = survives("gpu/lost", "lost at every 40th pass", "gpu:lost@40");
  std::printf("survived %llu losses\n", static_cast<unsigned long long>(status.gpu_failures));
  EXPECT_GE(status.gpu_failures, 5u);
  EXPECT_GE(gl_->generation(), generation + 5);
}

TEST_F(Gpu, OutOfMemory) {
  const PipelineStatus status = survives("gpu/memory", "out of memory at every 60th pass", "gpu:memory@60");
  EXPECT_GE(status.gpu_failures, 3u);
}

TEST_F(Gpu, ShaderRefused) {
  (void)survives("gpu/shader", "one variant refused once", "gpu:shader@1");
  // It was a shader of the mission that was refused: the next one is not.
  const auto next =
      gl_->submit(gl::Priority::Mapping, "next",
                  [](gl::Context& context) -> Result<void> {
                    const gl::ShaderFile file{
                        "next.frag",
                        "layout(location = 0) out vec4 color; void main() { color = vec4(1.0); }"};
                    auto program = gl::Program::fullScreen(context, {&file, 1});
                    if (!program) return tl::unexpected(program.error());
                    return {};
                  })
          .get();
  EXPECT_TRUE(next) << next.error().message;
}

TEST_F(Gpu, OfNoUseIsReported) {
  const PipelineFolder folder;
  Pipeline pipeline(settingsHere(), smokeSource(0), folder.path, *gl_);
  pipeline.setGpuHook([](gl::Context& context, std::uint64_t count) {
    if (count >= 20) context.injectLoss();
  });
  ASSERT_TRUE(pipeline.start());
  EXPECT_FALSE(waitUntilMapped(pipeline));
  const PipelineStatus status = pipeline.status();
  EXPECT_NE(status.error.find("lost"), std::string::npos) << status.error;
  EXPECT_GE(status.gpu_failures, 8u);
  expectAtMost("gpu/of-no-use", "tries before the mission ends with the reason",
               static_cast<double>(status.gpu_failures), 8);
}

}  // namespace
}  // namespace overfly::test
