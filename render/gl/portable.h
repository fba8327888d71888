#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "render/gl/program.h"

namespace overfly::gl {

enum class Stage { Vertex, Fragment, Compute };

// What in a shader goes beyond the minimum that OpenGL ES 3.1 promises (tables 20.40 ff.), and so may be
// refused by a small GPU though a large one or a software rasteriser takes it: one sentence each, with the
// file's name. Judged from the text after preprocessing with these defines: work group size <= 128
// invocations, shared memory <= 16 KB, samplers <= 16, images of the formats of table 8.26 and storage blocks
// in compute only (<= 4 each), render targets <= 4, no #extension. A size that depends on a define which is
// not given is not judged.
[[nodiscard]] std::vector<std::string> checkPortable(Stage stage, std::span<const ShaderFile> files,
                                                     std::span<const Define> defines = {});

// The stage that a shader file's ending names: .vert, .frag, .comp; nullopt for parts (.glsl).
[[nodiscard]] std::optional<Stage> stageOfFile(std::string_view name);

}  // namespace overfly::gl
