#include "render/gl/portable.h"

#include <fmt/core.h>

#include <map>
#include <regex>

#include "render/gl/detail/preprocess.h"

namespace overfly::gl {
namespace {

using detail::Macros;

// OpenGL ES 3.1, tables 20.41 to 20.47.
constexpr int kInvocations = 128;
constexpr int kSharedBytes = 16384;
constexpr int kSamplers = 16;
constexpr int kComputeImages = 4;
constexpr int kComputeStorageBlocks = 4;
constexpr int kRenderTargets = 4;

// Elements of "[a][b]", 1 without; nullopt when a size is not known.
std::optional<std::int64_t> elements(const std::string& dimensions, const Macros& macros) {
  static const std::regex one(R"(\[([^\]]*)\])");
  std::int64_t out = 1;
  for (std::sregex_iterator it(dimensions.begin(), dimensions.end(), one), end; it != end; ++it) {
    const auto size = detail::evaluate((*it)[1].str(), macros, false);
    if (!size) return std::nullopt;
    out *= *size;
  }
  return out;
}

// Bytes of a type in shared memory, vec3 counted as four components.
std::optional<int> bytesOf(const std::string& type) {
  static const std::map<std::string, int> kBytes{
      {"float", 4},  {"int", 4},    {"uint", 4},  {"bool", 4},   {"vec2", 8},   {"ivec2", 8},
      {"uvec2", 8},  {"bvec2", 8},  {"vec3", 16}, {"ivec3", 16}, {"uvec3", 16}, {"vec4", 16},
      {"ivec4", 16}, {"uvec4", 16}, {"mat2", 16}, {"mat3", 48},  {"mat4", 64}};
  const auto found = kBytes.find(type);
  if (found == kBytes.end()) return std::nullopt;
  return found->second;
}

class Checker {
 public:
  Checker(Stage stage, std::string name, std::string text, Macros macros)
      : stage_(stage), name_(std::move(name)), text_(std::move(text)), macros_(std::move(macros)) {}

  std::vector<std::string> run() {
    extensions();
    groupSize();
    sharedMemory();
    samplers();
    images();
    storageBlocks();
    renderTargets();
    return std::move(problems_);
  }

 private:
  template <typename... Args>
  void problem(fmt::format_string<Args...> format, Args&&... args) {
    problems_.push_back(fmt::format("{}: {}", name_, fmt::format(format, std::forward<Args>(args)...)));
  }
  template <typename Visit>
  void each(const std::regex& pattern, Visit visit) const {
    for (std::sregex_iterator it(text_.begin(), text_.end(), pattern), end; it != end; ++it) visit(*it);
  }

  // The dimensions of every variable in "a[2], b": commas do not occur within brackets.
  template <typename Visit>
  static void eachDeclared(const std::string& list, Visit visit) {
    static const std::regex one(R"((\w+)\s*((?:\[[^\]]*\]\s*)*))");
    for (std::sregex_iterator it(list.begin(), list.end(), one), end; it != end; ++it) visit((*it)[2].str());
  }

  void extensions() {
    static const std::regex pattern(R"(#extension ([^\n]*))");
    each(pattern, [this](const std::smatch& m) { problem("asks for an extension ({})", m[1].str()); });
  }

  void groupSize() {
    static const std::regex pattern(R"(local_size_([xyz])\s*=\s*([^,)]+(?:\([^)]*\)[^,)]*)*))");
    std::int64_t product = 1;
    bool known = true;
    each(pattern, [&](const std::smatch& m) {
      const auto size = detail::evaluate(m[2].str(), macros_, false);
      known = known && size.has_value();
      product *= size.value_or(1);
      if (size && m[1].str() == "z" && *size > 64)
        problem("local_size_z is {}, at most 64 is promised", *size);
    });
    if (product > kInvocations) {
      problem("a work group has {}{} invocations, {} are promised", known ? "" : "at least ", product,
              kInvocations);
    }
  }

  void sharedMemory() {
    static const std::regex pattern(R"(\bshared\s+(?:(?:highp|mediump|lowp)\s+)?(\w+)\s+([^;]+);)");
    std::int64_t bytes = 0;
    each(pattern, [&](const std::smatch& m) {
      const auto size = bytesOf(m[1].str());
      if (!size) {
        problem("the size of shared type {} is not known to this check", m[1].str());
        return;
      }
      eachDeclared(m[2].str(), [&](const std::string& dimensions) {
        bytes += *size * elements(dimensions, macros_).value_or(0);
      });
    });
    if (bytes > kSharedBytes) problem("{} bytes of shared memory, {} are promised", bytes, kSharedBytes);
  }

  void samplers() {
    static const std::regex pattern(
        R"(\buniform\s+(?:(?:highp|mediump|lowp)\s+)?[iu]?sampler\w+\s+([^;]+);)");
    std::int64_t count = 0;
    each(pattern, [&](const std::smatch& m) {
      eachDeclared(m[1].str(), [&](const std::string& dimensions) {
        count += elements(dimensions, macros_).value_or(1);
      });
    });
    if (count > kSamplers) problem("{} samplers, {} are promised", count, kSamplers);
  }

  void images() {
    static const std::regex pattern(
        R"((?:layout\s*\(([^)]*)\)\s*)?(?:(?:readonly|writeonly|coherent|restrict|volatile|highp|mediump|lowp)\s+)*uniform\s+(?:(?:readonly|writeonly|coherent|restrict|volatile|highp|mediump|lowp)\s+)*[iu]?image\w+\s+(\w+)\s*((?:\[[^\]]*\]\s*)*);)");
    std::int64_t count = 0;
    each(pattern, [&](const std::smatch& m) {
      count += elements(m[3].str(), macros_).value_or(1);
      if (!hasPortableFormat(m[1].str())) {
        problem("image {} has a format that is not promised ({})", m[2].str(), m[1].str());
      }
    });
    if (stage_ != Stage::Compute && count > 0) problem("images outside compute shaders are not promised");
    if (count > kComputeImages) problem("{} images, {} are promised", count, kComputeImages);
  }

  // Table 8.26; a format that is a define not given here is not judged.
  static bool hasPortableFormat(const std::string& layout) {
    static const std::regex format(
        R"(\b(rgba32f|rgba16f|r32f|rgba32ui|rgba16ui|rgba8ui|r32ui|rgba32i|rgba16i|rgba8i|r32i|rgba8|rgba8_snorm)\b)");
    static const std::regex other(R"(\b(r|rg|rgba|rgb)(8|16|32)\w*\b|\br11f_g11f_b10f\b|\brgb10_a2\w*\b)");
    return std::regex_search(layout, format) || !std::regex_search(layout, other);
  }

  void storageBlocks() {
    static const std::regex pattern(R"(\bbuffer\s+\w+\s*\{)");
    int count = 0;
    each(pattern, [&count](const std::smatch&) { ++count; });
    if (stage_ != Stage::Compute && count > 0)
      problem("storage blocks outside compute shaders are not promised");
    if (count > kComputeStorageBlocks)
      problem("{} storage blocks, {} are promised", count, kComputeStorageBlocks);
  }

  void renderTargets() {
    if (stage_ != Stage::Fragment) return;
    static const std::regex pattern(R"(layout\s*\(\s*location\s*=\s*(\d+)\s*\)\s*out\b)");
    each(pattern, [this](const std::smatch& m) {
      if (std::stoi(m[1].str()) >= kRenderTargets) problem("more than {} render targets", kRenderTargets);
    });
  }

  Stage stage_;
  std::string name_;
  std::string text_;
  Macros macros_;
  std::vector<std::string> problems_;
};

}  // namespace

std::vector<std::string> checkPortable(Stage stage, std::span<const ShaderFile> files,
                                       std::span<const Define> defines) {
  Macros macros{{"GL_ES", "1"}, {"__VERSION__", "310"}};
  for (const Define& define : defines) macros[define.name] = define.value;
  std::string whole;
  for (const ShaderFile& file : files) {
    whole += file.text;
    whole += '\n';
  }
  std::string text = detail::preprocess(whole, macros);
  return Checker(stage, files.empty() ? "" : std::string(files.back().name), std::move(text),
                 std::move(macros))
      .run();
}

std::optional<Stage> stageOfFile(std::string_view name) {
  if (name.ends_with(".vert")) return Stage::Vertex;
  if (name.ends_with(".frag")) return Stage::Fragment;
  if (name.ends_with(".comp")) return Stage::Compute;
  return std::nullopt;
}

}  // namespace overfly::gl
