#include "render/gl/program.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <regex>
#include <sstream>
#include <stdexcept>

#include "render/gl/detail/context_state.h"
#include "render/gl/portable.h"

namespace overfly::gl {
namespace {

constexpr std::string_view kPrelude =
    "#version 310 es\n"
    "precision highp float;\n"
    "precision highp int;\n"
    "precision highp sampler2D;\n"
    "precision highp sampler2DArray;\n"
    "precision highp sampler2DMS;\n"
    "precision highp isampler2D;\n"
    "precision highp usampler2D;\n"
    "precision highp isampler2DArray;\n"
    "precision highp usampler2DArray;\n"
    "precision highp image2D;\n"
    "precision highp uimage2D;\n"
    "precision highp iimage2D;\n"
    "precision highp image2DArray;\n"
    "precision highp uimage2DArray;\n"
    "precision highp iimage2DArray;\n";

constexpr ShaderFile kFullScreenVertex{"fullscreen.vert",
                                       "out vec2 uv;\n"
                                       "void main() {\n"
                                       "  uv = vec2(float((gl_VertexID << 1) & 2), float(gl_VertexID & 2));\n"
                                       "  gl_Position = vec4(uv * 2.0 - 1.0, 0.0, 1.0);\n"
                                       "}\n"};

// Files of one stage are told apart by their line numbers: Mesa 22 forgets the second number of #line.
constexpr std::size_t kLinesPerFile = 100000;

const char* stageName(GLenum stage) {
  switch (stage) {
    case GL_COMPUTE_SHADER:
      return "compute";
    case GL_VERTEX_SHADER:
      return "vertex";
    default:
      return "fragment";
  }
}

std::string assemble(std::span<const ShaderFile> files, std::span<const Define> defines) {
  std::string out(kPrelude);
  for (const Define& define : defines) out += fmt::format("#define {} {}\n", define.name, define.value);
  for (std::size_t i = 0; i < files.size(); ++i) {
    out += fmt::format("#line {}\n", i * kLinesPerFile + 1);
    out += files[i].text;
    if (!files[i].text.empty() && files[i].text.back() != '\n') out += '\n';
  }
  return out;
}

// Drivers write "0:12(3): error: ..." (Mesa), "0(12) : error ..." (NVIDIA), "ERROR: 0:12: ..." (ARM, ANGLE,
// Qualcomm), "0:12: L0001: ..." (Mali): string index, then line, then on Mesa the column.
std::string withFileNames(const std::string& log, std::span<const ShaderFile> files) {
  static const std::regex place(R"(\d+[:(](\d+)\)?(\(\d+\))?)");
  std::istringstream lines(log);
  std::vector<std::string> out;
  for (std::string line; std::getline(lines, line);) {
    while (!line.empty() && (line.back() == '\0' || line.back() == '\r')) line.pop_back();
    if (line.empty()) continue;
    std::smatch match;
    if (std::regex_search(line, match, place)) {
      const std::size_t number = std::stoul(match[1].str());
      const std::size_t file = number / kLinesPerFile;
      if (file < files.size()) {
        line = fmt::format("{}{}:{}{}", match.prefix().str(), files[file].name, number % kLinesPerFile,
                           match.suffix().str());
      }
    }
    out.push_back(std::move(line));
  }
  return fmt::format("{}", fmt::join(out, "\n"));
}

template <typename Get, typename Read>
std::string infoLog(GLuint name, Get get, Read read) {
  GLint length = 0;
  get(name, GL_INFO_LOG_LENGTH, &length);
  std::string text(static_cast<std::size_t>(std::max(length, 0)), '\0');
  if (length > 0) read(name, length, nullptr, text.data());
  return text;
}

// A compiled stage, deleted at the end of linking.
struct CompiledStage {
  GLuint name = 0;
  CompiledStage() = default;
  CompiledStage(CompiledStage&& other) noexcept : name(std::exchange(other.name, 0)) {}
  CompiledStage& operator=(CompiledStage&&) = delete;
  ~CompiledStage() {
    if (name != 0) glDeleteShader(name);
  }
};

// In a debugging context a shader that a smaller GPU may refuse is an error, so that tests find it.
void recordUnportable(detail::ContextState& state, GLenum kind, std::span<const ShaderFile> files,
                      std::span<const Define> defines) {
  if (!state.info.debug) return;
  const Stage stage = kind == GL_COMPUTE_SHADER  ? Stage::Compute
                      : kind == GL_VERTEX_SHADER ? Stage::Vertex
                                                 : Stage::Fragment;
  for (std::string& problem : checkPortable(stage, files, defines)) state.recordError(std::move(problem));
}

Result<CompiledStage> compile(detail::ContextState& state, GLenum kind, std::span<const ShaderFile> files,
                              std::span<const Define> defines) {
  recordUnportable(state, kind, files, defines);
  CompiledStage stage;
  stage.name = glCreateShader(kind);
  std::string text = assemble(files, defines);
  if (std::exchange(state.refuse_shader, false)) text += "\n#error a refusal was asked for\n";
  const char* begin = text.c_str();
  const auto length = static_cast<GLint>(text.size());
  glShaderSource(stage.name, 1, &begin, &length);
  glCompileShader(stage.name);
  GLint done = GL_FALSE;
  glGetShaderiv(stage.name, GL_COMPILE_STATUS, &done);
  if (done != GL_TRUE) {
    const std::string log = infoLog(stage.name, glGetShaderiv, glGetShaderInfoLog);
    return fail(ErrorCode::Internal,
                fmt::format("A {} shader does not compile:\n{}", stageName(kind), withFileNames(log, files)));
  }
  return stage;
}

Result<detail::Object> link(const detail::StatePtr& state, std::span<const CompiledStage> stages,
                            std::string_view name) {
  detail::Object object(state, detail::ObjectKind::Program, glCreateProgram());
  for (const CompiledStage& stage : stages) glAttachShader(object.name(), stage.name);
  glLinkProgram(object.name());
  GLint done = GL_FALSE;
  glGetProgramiv(object.name(), GL_LINK_STATUS, &done);
  if (done != GL_TRUE) {
    return fail(ErrorCode::Internal,
                fmt::format("The program of {} does not link:\n{}", name,
                            infoLog(object.name(), glGetProgramiv, glGetProgramInfoLog)));
  }
  return object;
}

}  // namespace

Result<Program> Program::compute(Context& context, std::span<const ShaderFile> files,
                                 std::span<const Define> defines) {
  if (auto ready = context.state()->outcome("Compiling a shader"); !ready) {
    return tl::unexpected(ready.error());
  }
  auto stage = compile(*context.state(), GL_COMPUTE_SHADER, files, defines);
  if (!stage) return tl::unexpected(stage.error());
  auto object = link(context.state(), std::span<const CompiledStage>(&*stage, 1), files.back().name);
  if (!object) return tl::unexpected(object.error());
  Program out;
  out.object_ = std::move(*object);
  for (const ShaderFile& file : files) out.source_ += file.text;
  glGetProgramiv(out.object_.name(), GL_COMPUTE_WORK_GROUP_SIZE, out.group_size_.data());
  return out;
}

Result<Program> Program::raster(Context& context, std::span<const ShaderFile> vertex,
                                std::span<const ShaderFile> fragment, std::span<const Define> defines) {
  if (auto ready = context.state()->outcome("Compiling a shader"); !ready) {
    return tl::unexpected(ready.error());
  }
  auto first = compile(*context.state(), GL_VERTEX_SHADER, vertex, defines);
  if (!first) return tl::unexpected(first.error());
  auto second = compile(*context.state(), GL_FRAGMENT_SHADER, fragment, defines);
  if (!second) return tl::unexpected(second.error());
  const std::array<CompiledStage, 2> stages{std::move(*first), std::move(*second)};
  auto object = link(context.state(), stages, fragment.back().name);
  if (!object) return tl::unexpected(object.error());
  Program out;
  out.object_ = std::move(*object);
  for (const ShaderFile& file : vertex) out.source_ += file.text;
  for (const ShaderFile& file : fragment) out.source_ += file.text;
  return out;
}

Result<Program> Program::fullScreen(Context& context, std::span<const ShaderFile> fragment,
                                    std::span<const Define> defines) {
  return raster(context, std::span<const ShaderFile>(&kFullScreenVertex, 1), fragment, defines);
}

int Program::location(std::string_view name) {
  const auto known = locations_.find(name);
  if (known != locations_.end()) return known->second;
  const std::string text(name);
  const int found = glGetUniformLocation(object_.name(), text.c_str());
  if (found < 0) {
    const std::string plain = text.substr(0, text.find_first_of("[."));
    if (source_.find(plain) == std::string::npos) {
      throw std::logic_error(fmt::format("no shader of this program mentions a uniform '{}'", plain));
    }
  }
  locations_.emplace(text, found);
  return found;
}

void Program::set(std::string_view name, int value) {
  const int at = location(name);
  glProgramUniform1i(object_.name(), at, value);
}
void Program::set(std::string_view name, unsigned value) {
  const int at = location(name);
  glProgramUniform1ui(object_.name(), at, value);
}
void Program::set(std::string_view name, float value) {
  const int at = location(name);
  glProgramUniform1f(object_.name(), at, value);
}
void Program::set(std::string_view name, const Eigen::Vector2f& value) {
  const int at = location(name);
  glProgramUniform2fv(object_.name(), at, 1, value.data());
}
void Program::set(std::string_view name, const Eigen::Vector3f& value) {
  const int at = location(name);
  glProgramUniform3fv(object_.name(), at, 1, value.data());
}
void Program::set(std::string_view name, const Eigen::Vector4f& value) {
  const int at = location(name);
  glProgramUniform4fv(object_.name(), at, 1, value.data());
}
void Program::set(std::string_view name, const Eigen::Vector2i& value) {
  const int at = location(name);
  glProgramUniform2iv(object_.name(), at, 1, value.data());
}
void Program::set(std::string_view name, const Eigen::Matrix3f& value) {
  const int at = location(name);
  glProgramUniformMatrix3fv(object_.name(), at, 1, GL_FALSE, value.data());
}
void Program::set(std::string_view name, const Eigen::Matrix4f& value) {
  const int at = location(name);
  glProgramUniformMatrix4fv(object_.name(), at, 1, GL_FALSE, value.data());
}
void Program::set(std::string_view name, const Eigen::Matrix<float, 3, 4>& value) {
  set(name, std::span<const Eigen::Matrix<float, 3, 4>>(&value, 1));
}
void Program::set(std::string_view name, std::span<const int> values) {
  const int at = location(name);
  glProgramUniform1iv(object_.name(), at, static_cast<GLsizei>(values.size()), values.data());
}
void Program::set(std::string_view name, std::span<const float> values) {
  const int at = location(name);
  glProgramUniform1fv(object_.name(), at, static_cast<GLsizei>(values.size()), values.data());
}
void Program::set(std::string_view name, std::span<const Eigen::Vector2f> values) {
  const int at = location(name);
  if (values.empty()) return;
  glProgramUniform2fv(object_.name(), at, static_cast<GLsizei>(values.size()), values.front().data());
}
void Program::set(std::string_view name, std::span<const Eigen::Vector3f> values) {
  const int at = location(name);
  if (values.empty()) return;
  glProgramUniform3fv(object_.name(), at, static_cast<GLsizei>(values.size()), values.front().data());
}
void Program::set(std::string_view name, std::span<const Eigen::Vector4f> values) {
  const int at = location(name);
  if (values.empty()) return;
  glProgramUniform4fv(object_.name(), at, static_cast<GLsizei>(values.size()), values.front().data());
}
void Program::set(std::string_view name, std::span<const Eigen::Matrix<float, 3, 4>> values) {
  static_assert(sizeof(Eigen::Matrix<float, 3, 4>) == 12 * sizeof(float));
  const int at = location(name);
  if (values.empty()) return;
  glProgramUniformMatrix4x3fv(object_.name(), at, static_cast<GLsizei>(values.size()), GL_FALSE,
                              values.front().data());
}

void Program::setTexture(std::string_view name, int unit, const Texture& texture) {
  set(name, unit);
  texture.bind(unit);
}

void Program::use() const { glUseProgram(object_.name()); }

}  // namespace overfly::gl
