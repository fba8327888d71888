#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <future>
#include <numeric>
#include <thread>

#include "render/gl/commands.h"
#include "render/gl/fence.h"
#include "render/gl/timer.h"
#include "tests/unit/gl/gl_fixture.h"

namespace overfly::gl {
namespace {

using ::testing::HasSubstr;

class GlObjects : public test::GlTest {};

template <typename T>
std::vector<T> iotaVector(std::size_t count) {
  std::vector<T> out(count);
  for (std::size_t i = 0; i < count; ++i) out[i] = static_cast<T>(i % 251);
  return out;
}

TEST_F(GlObjects, ContextReportsAtLeastTheEs31Minimum) {
  const DeviceInfo& info = context().info();
  EXPECT_TRUE(info.major > 3 || (info.major == 3 && info.minor >= 1)) << info.version;
  EXPECT_FALSE(info.renderer.empty());
  EXPECT_GE(info.limits.compute_invocations, 128);
  EXPECT_GE(info.limits.compute_shared_bytes, 16384);
  EXPECT_GE(info.limits.texture_units, 16);
  EXPECT_TRUE(info.support(Format::RGBA8).renderable);
  EXPECT_TRUE(info.support(Format::R8).filterable);
  EXPECT_FALSE(info.support(Format::R32UI).filterable);
}

TEST_F(GlObjects, ComputeSeesDefinesUniformsAndStorage) {
  constexpr ShaderFile file{"twice.comp",
                            "layout(local_size_x = 64) in;\n"
                            "layout(std430, binding = 0) buffer Data { uint values[]; };\n"
                            "uniform uint add;\n"
                            "void main() {\n"
                            "  uint i = gl_GlobalInvocationID.x;\n"
                            "  if (i < uint(values.length())) values[i] = values[i] * FACTOR + add;\n"
                            "}\n"};
  const std::vector<Define> defines{{"FACTOR", "3u"}};
  OVERFLY_ASSERT_OK(program, Program::compute(context(), {&file, 1}, defines));
  EXPECT_EQ(program.groupSize(), (std::array<int, 3>{64, 1, 1}));
  std::vector<std::uint32_t> values(1000);
  std::iota(values.begin(), values.end(), 0u);
  OVERFLY_ASSERT_OK(buffer, Buffer::from<std::uint32_t>(context(), values));
  program.set("add", 7u);
  buffer.bindStorage(0);
  dispatchOver(program, 1000, 1);
  ASSERT_TRUE(buffer.download(std::span(values)));
  for (std::uint32_t i = 0; i < 1000; ++i) ASSERT_EQ(values[i], i * 3 + 7) << i;
}

TEST_F(GlObjects, CompileErrorNamesFileAndLine) {
  constexpr std::array<ShaderFile, 2> files{
      ShaderFile{"common.glsl", "float half_of(float x) { return x / 2.0; }\n"},
      ShaderFile{"broken.comp",
                 "layout(local_size_x = 1) in;\n"
                 "void main() {\n"
                 "  int x = not_declared;\n"
                 "}\n"}};
  const auto program = Program::compute(context(), files);
  ASSERT_FALSE(program.has_value());
  EXPECT_EQ(program.error().code, ErrorCode::Internal);
  EXPECT_THAT(program.error().message, HasSubstr("broken.comp:3"));
  EXPECT_THAT(program.error().message, HasSubstr("not_declared"));
}

TEST_F(GlObjects, MisspeltUniformIsAProgrammingErrorAnUnusedOneIsNot) {
  constexpr ShaderFile file{"unused.comp",
                            "layout(local_size_x = 1) in;\nuniform float unused;\nvoid main() {}\n"};
  OVERFLY_ASSERT_OK(program, Program::compute(context(), {&file, 1}));
  EXPECT_NO_THROW(program.set("unused", 1.0f));
  EXPECT_THROW(program.set("unsued", 1.0f), std::logic_error);
}

template <typename T>
void expectRoundTrip(Context& context, Format format) {
  constexpr int kWidth = 7, kHeight = 5;
  for (const int layers : {0, 3}) {
    OVERFLY_ASSERT_OK(texture, Texture::create(context, {format, kWidth, kHeight, layers, kFullChain}));
    const auto in = iotaVector<T>(static_cast<std::size_t>(kWidth * kHeight * channels(format)));
    const int layer = layers > 0 ? 2 : 0;
    texture.upload(std::span<const T>(in), 0, layer);
    std::vector<T> out(in.size());
    const auto read = texture.download(std::span<T>(out), 0, layer);
    if (!context.info().support(format).renderable) {
      EXPECT_EQ(read.error().code, ErrorCode::Unsupported);
      continue;
    }
    ASSERT_TRUE(read.has_value()) << read.error().message;
    EXPECT_EQ(in, out) << formatName(format);
  }
}

TEST_F(GlObjects, TexelsComeBackAsTheyWentUp) {
  for (const Format f :
       {Format::R8, Format::RG8, Format::RGB8, Format::RGBA8, Format::R8UI, Format::RGBA8UI}) {
    expectRoundTrip<std::uint8_t>(context(), f);
  }
  for (const Format f :
       {Format::R16F, Format::RG16F, Format::RGBA16F, Format::R32F, Format::RG32F, Format::RGBA32F}) {
    expectRoundTrip<float>(context(), f);
  }
  expectRoundTrip<std::uint16_t>(context(), Format::R16UI);
  for (const Format f : {Format::R32UI, Format::RG32UI, Format::RGBA32UI}) {
    expectRoundTrip<std::uint32_t>(context(), f);
  }
  expectRoundTrip<std::int32_t>(context(), Format::R32I);
}

TEST_F(GlObjects, UploadWithStrideTakesTheRectangleOnly) {
  OVERFLY_ASSERT_OK(texture, Texture::create(context(), {Format::R8, 4, 4}));
  const std::vector<std::uint8_t> zero(16, 0);
  texture.upload(std::span<const std::uint8_t>(zero));
  const auto source = iotaVector<std::uint8_t>(10 * 2);
  texture.upload(std::span<const std::uint8_t>(source), Rect{1, 2, 3, 2}, 0, 0, 10);
  std::vector<std::uint8_t> out(16);
  ASSERT_TRUE(texture.download(std::span(out)));
  EXPECT_EQ(out, (std::vector<std::uint8_t>{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 0, 10, 11, 12}));
  EXPECT_THROW(texture.upload(std::span<const std::uint8_t>(zero), Rect{2, 0, 3, 1}), std::logic_error);
  const std::vector<float> wrong(16);
  EXPECT_THROW(texture.upload(std::span<const float>(wrong)), std::logic_error);
}

TEST_F(GlObjects, MultipleTargetsReceiveAFullScreenPass) {
  constexpr ShaderFile file{"mrt.frag",
                            "in vec2 uv;\n"
                            "layout(location = 0) out vec4 color;\n"
                            "layout(location = 1) out float height;\n"
                            "layout(location = 2) out vec2 pair;\n"
                            "layout(location = 3) out uint id;\n"
                            "void main() {\n"
                            "  color = vec4(uv, 0.0, 1.0);\n"
                            "  height = 1000.0 + gl_FragCoord.y;\n"
                            "  pair = gl_FragCoord.xy;\n"
                            "  id = uint(gl_FragCoord.x) + 8u * uint(gl_FragCoord.y);\n"
                            "}\n"};
  OVERFLY_ASSERT_OK(program, Program::fullScreen(context(), {&file, 1}));
  OVERFLY_ASSERT_OK(color, Texture::create(context(), {Format::RGBA8, 8, 4}));
  OVERFLY_ASSERT_OK(height, Texture::create(context(), {Format::R32F, 8, 4}));
  OVERFLY_ASSERT_OK(pair, Texture::create(context(), {Format::RG32F, 8, 4}));
  OVERFLY_ASSERT_OK(id, Texture::create(context(), {Format::R32UI, 8, 4, 2}));
  const std::array<Attachment, 4> targets{Attachment{&color}, {&height}, {&pair}, {&id, 0, 1}};
  OVERFLY_ASSERT_OK(framebuffer, Framebuffer::create(context(), targets));
  drawFullScreen(program, framebuffer);
  std::vector<float> heights(32);
  ASSERT_TRUE(height.download(std::span(heights)));
  EXPECT_FLOAT_EQ(heights[0], 1000.5f);
  EXPECT_FLOAT_EQ(heights[31], 1003.5f);
  std::vector<std::uint32_t> ids(32);
  ASSERT_TRUE(id.download(std::span(ids), 0, 1));
  for (std::uint32_t i = 0; i < 32; ++i) EXPECT_EQ(ids[i], i);
  std::vector<float> pairs(64);
  ASSERT_TRUE(pair.download(std::span(pairs)));
  EXPECT_FLOAT_EQ(pairs[62], 7.5f);
  std::vector<std::uint8_t> colors(128);
  ASSERT_TRUE(color.download(std::span(colors)));
  EXPECT_NEAR(colors[0], 255.0 / 16, 1);
  EXPECT_NEAR(colors[1], 255.0 / 8, 1);
}

TEST_F(GlObjects, ImageStoreThenSampledReadSeesTheValues) {
  constexpr ShaderFile write{"write.comp",
                             "layout(local_size_x = 8, local_size_y = 8) in;\n"
                             "layout(r32f, binding = 0) writeonly uniform image2D target;\n"
                             "void main() {\n"
                             "  ivec2 p = ivec2(gl_GlobalInvocationID.xy);\n"
                             "  imageStore(target, p, vec4(float(p.x * 100 + p.y)));\n"
                             "}\n"};
  constexpr ShaderFile read{"read.comp",
                            "layout(local_size_x = 8, local_size_y = 8) in;\n"
                            "uniform sampler2D source;\n"
                            "layout(std430, binding = 1) buffer Out { float result[]; };\n"
                            "void main() {\n"
                            "  ivec2 p = ivec2(gl_GlobalInvocationID.xy);\n"
                            "  result[p.y * 16 + p.x] = texelFetch(source, p, 0).r;\n"
                            "}\n"};
  OVERFLY_ASSERT_OK(writer, Program::compute(context(), {&write, 1}));
  OVERFLY_ASSERT_OK(reader, Program::compute(context(), {&read, 1}));
  OVERFLY_ASSERT_OK(image, Texture::create(context(), {Format::R32F, 16, 16}));
  OVERFLY_ASSERT_OK(result, Buffer::create(context(), 256 * sizeof(float)));
  image.bindImage(0, ImageAccess::Write);
  dispatchOver(writer, 16, 16);
  reader.setTexture("source", 3, image);
  result.bindStorage(1);
  dispatchOver(reader, 16, 16);
  std::vector<float> values(256);
  ASSERT_TRUE(result.download(std::span(values)));
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) {
      ASSERT_EQ(values[static_cast<std::size_t>(y * 16 + x)], static_cast<float>(x * 100 + y));
    }
  }
}

TEST_F(GlObjects, MipLevelsAreBoxMeans) {
  OVERFLY_ASSERT_OK(texture, Texture::create(context(), {Format::R8, 4, 4, 0, kFullChain}));
  EXPECT_EQ(texture.spec().levels, 3);
  EXPECT_EQ(texture.bytes(), 16u + 4u + 1u);
  const std::vector<std::uint8_t> in{10, 20, 0, 0, 30, 40, 0, 0, 0, 0, 100, 100, 0, 0, 100, 100};
  texture.upload(std::span<const std::uint8_t>(in));
  texture.generateMips();
  std::vector<std::uint8_t> half(4);
  ASSERT_TRUE(texture.download(std::span(half), 1));
  EXPECT_EQ(half, (std::vector<std::uint8_t>{25, 0, 0, 100}));
}

TEST_F(GlObjects, GeometryIsDrawnInstancedWithDepth) {
  constexpr ShaderFile vertex{
      "quad.vert",
      "layout(location = 0) in vec2 corner;\n"
      "layout(location = 1) in float depth;\n"
      "flat out int instance;\n"
      "void main() { gl_Position = vec4(corner, depth, 1.0); instance = gl_InstanceID; }\n"};
  constexpr ShaderFile fragment{"quad.frag",
                                "flat in int instance;\n"
                                "layout(location = 0) out uint id;\n"
                                "void main() { id = uint(instance) + 1u; }\n"};
  const std::vector<float> corners{-1, -1, 1, -1, -1, 1, 1, 1};
  const std::vector<float> depths{0.5f, -0.5f, 0.0f};  // the second instance is nearest
  const std::vector<std::uint32_t> order{0, 1, 2, 2, 1, 3};
  OVERFLY_ASSERT_OK(program, Program::raster(context(), {&vertex, 1}, {&fragment, 1}));
  OVERFLY_ASSERT_OK(corner_buffer, Buffer::from<float>(context(), corners));
  OVERFLY_ASSERT_OK(depth_buffer, Buffer::from<float>(context(), depths));
  OVERFLY_ASSERT_OK(indices, Buffer::from<std::uint32_t>(context(), order));
  const std::array<Attribute, 2> attributes{
      Attribute{0, &corner_buffer, AttributeType::Float, 2, 8, 0, false},
      Attribute{1, &depth_buffer, AttributeType::Float, 1, 4, 0, true}};
  OVERFLY_ASSERT_OK(quad, VertexArray::create(context(), attributes, &indices));
  OVERFLY_ASSERT_OK(id, Texture::create(context(), {Format::R32UI, 4, 4}));
  OVERFLY_ASSERT_OK(depth, Texture::create(context(), {Format::Depth24, 4, 4}));
  const Attachment color{&id};
  OVERFLY_ASSERT_OK(framebuffer, Framebuffer::create(context(), {&color, 1}, {&depth}));
  framebuffer.clearColorUint(0, 0, 0, 0, 0);
  framebuffer.clearDepth(1.0f);
  DrawState state;
  state.depth_test = true;
  state.depth_write = true;
  draw(program, framebuffer, quad, 6, 3, state);
  std::vector<std::uint32_t> ids(16);
  ASSERT_TRUE(id.download(std::span(ids)));
  EXPECT_EQ(ids, std::vector<std::uint32_t>(16, 2));
}

TEST_F(GlObjects, FenceAndTimerFinish) {
  OVERFLY_ASSERT_OK(timer, GpuTimer::create(context()));
  OVERFLY_ASSERT_OK(buffer, Buffer::create(context(), 1 << 20));
  timer.start();
  buffer.clear();
  timer.stop();
  Fence fence = Fence::insert(context());
  const auto done = fence.wait(std::chrono::seconds(5));
  ASSERT_TRUE(done.has_value());
  EXPECT_TRUE(*done);
  EXPECT_TRUE(fence.done());
  const auto elapsed = timer.elapsed();
  EXPECT_LT(elapsed.value_or(std::chrono::seconds(0)), std::chrono::seconds(5));
}

TEST_F(GlObjects, ErrorsAreCollectedForTheTestToFail) {
  OVERFLY_ASSERT_OK(texture, Texture::create(context(), {Format::R8, 4, 4}));
  texture.bindImage(1000, ImageAccess::Write);  // no such unit anywhere
  EXPECT_FALSE(context().takeErrors().empty());
  EXPECT_TRUE(context().takeErrors().empty());
}

TEST(GlContext, OutOfMemoryIsUnavailableAndTheContextGoesOn) {
  auto context = Context::create();
  ASSERT_TRUE(context.has_value()) << context.error().message;
  const auto huge = Buffer::create(*context, std::size_t{1} << 60);
  ASSERT_FALSE(huge.has_value());
  EXPECT_EQ(huge.error().code, ErrorCode::Unavailable);
  EXPECT_TRUE(Buffer::create(*context, 1024).has_value());
  EXPECT_TRUE(context->check().has_value());
}

TEST(GlContext, LossIsReportedAndEverythingCanBeBuiltAgain) {
  auto context = Context::create();
  ASSERT_TRUE(context.has_value()) << context.error().message;
  auto before = Buffer::create(*context, 1024);
  ASSERT_TRUE(before.has_value());
  context->injectLoss();
  EXPECT_TRUE(context->lost());
  EXPECT_EQ(context->check().error().code, ErrorCode::Unavailable);
  EXPECT_EQ(Buffer::create(*context, 16).error().code, ErrorCode::Unavailable);
  EXPECT_EQ(Texture::create(*context, {Format::R8, 4, 4}).error().code, ErrorCode::Unavailable);
  context = Context::create();  // the buffer outlives its context: an empty shell from here on
  ASSERT_TRUE(context.has_value());
  EXPECT_TRUE(context->check().has_value());
  before = Buffer::create(*context, 1024);
  EXPECT_TRUE(before.has_value());
}

TEST(GlContext, SeveralContextsOnOneThreadDoNotMix) {
  auto a = Context::create();
  auto b = Context::create();
  ASSERT_TRUE(a && b);
  const std::vector<std::uint32_t> ones(4, 1), twos(4, 2);
  auto in_a = Buffer::from<std::uint32_t>(*a, ones);
  auto in_b = Buffer::from<std::uint32_t>(*b, twos);
  ASSERT_TRUE(in_a && in_b);
  std::vector<std::uint32_t> out(4);
  ASSERT_TRUE(in_a->download(std::span(out)));
  EXPECT_EQ(out, ones);
  ASSERT_TRUE(in_b->download(std::span(out)));
  EXPECT_EQ(out, twos);
}

TEST(GlContextDeathTest, UseOnAnotherThreadEndsTheProgram) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(
      {
        auto context = Context::create();
        std::thread([&] { context->finish(); }).join();
      },
      "off its context's thread");
}

}  // namespace
}  // namespace overfly::gl
