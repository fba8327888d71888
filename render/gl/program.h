#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"
#include "render/gl/buffer.h"
#include "render/gl/context.h"
#include "render/gl/texture.h"

namespace overfly::gl {

// A shader file: its name (for messages) and text. Embedded files come from the generated
// "<library>_shaders.h". The text carries no #version, precision or #extension line: they are prepended
// (ES 3.1, highp throughout).
struct ShaderFile {
  std::string_view name;
  std::string_view text;
};

// `#define name value`, prepended: how variants of one file are made.
struct Define {
  std::string name;
  std::string value = "1";
};

// A linked program. Thread-bound to its context. Setters by name: a name that the driver optimised away is
// ignored, one that stands nowhere in the source is a programming error (std::logic_error).
class Program {
 public:
  Program() = default;
  // The files of a stage are compiled as one text, in order: shared functions first, main last.
  // Internal with "file:line: message" of every error when the source does not compile or link.
  [[nodiscard]] static Result<Program> compute(Context& context, std::span<const ShaderFile> files,
                                               std::span<const Define> defines = {});
  [[nodiscard]] static Result<Program> raster(Context& context, std::span<const ShaderFile> vertex,
                                              std::span<const ShaderFile> fragment,
                                              std::span<const Define> defines = {});
  // A fragment pass over a full-screen triangle (see drawFullScreen): the built-in vertex stage hands
  // `in highp vec2 uv` on, (0, 0) at the first texel of memory's corner, (1, 1) at the far corner.
  [[nodiscard]] static Result<Program> fullScreen(Context& context, std::span<const ShaderFile> fragment,
                                                  std::span<const Define> defines = {});

  void set(std::string_view name, int value);
  void set(std::string_view name, unsigned value);
  void set(std::string_view name, float value);
  void set(std::string_view name, bool value) { set(name, value ? 1 : 0); }
  void set(std::string_view name, const Eigen::Vector2f& value);
  void set(std::string_view name, const Eigen::Vector3f& value);
  void set(std::string_view name, const Eigen::Vector4f& value);
  void set(std::string_view name, const Eigen::Vector2i& value);
  void set(std::string_view name, const Eigen::Matrix3f& value);
  void set(std::string_view name, const Eigen::Matrix4f& value);
  void set(std::string_view name, const Eigen::Matrix<float, 3, 4>& value);  // GLSL mat4x3
  void set(std::string_view name, std::span<const int> values);
  void set(std::string_view name, std::span<const float> values);
  void set(std::string_view name, std::span<const Eigen::Vector2f> values);
  void set(std::string_view name, std::span<const Eigen::Vector3f> values);
  void set(std::string_view name, std::span<const Eigen::Vector4f> values);
  void set(std::string_view name, std::span<const Eigen::Matrix<float, 3, 4>> values);

  // Binds the texture to the unit and the sampler uniform to it. An element of a sampler array is named
  // "views[2]".
  void setTexture(std::string_view name, int unit, const Texture& texture);

  // Work-group size of a compute program.
  [[nodiscard]] const std::array<int, 3>& groupSize() const { return group_size_; }
  [[nodiscard]] bool empty() const { return object_.empty(); }

  void use() const;  // makes it the program of following draws and dispatches

  [[nodiscard]] const detail::Object& object() const { return object_; }

 private:
  [[nodiscard]] int location(std::string_view name);

  detail::Object object_;
  std::string source_;  // of all stages, to tell misspelt names from unused ones
  std::map<std::string, int, std::less<>> locations_;
  std::array<int, 3> group_size_{0, 0, 0};
};

}  // namespace overfly::gl
