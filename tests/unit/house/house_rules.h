#pragma once
#include <filesystem>
#include <string>
#include <vector>

// The rules that the source tree itself must keep. Each function returns one sentence per breach, with file
// and line, and an empty list for a tree that keeps the rule.
namespace overfly::house {

// Rooms in their order; each may include and link only itself and those before it.
inline const std::vector<std::string> kRooms{"config", "capture", "render", "tiling", "daemon"};

// Includes only point down that order, name their room in full ("capture/frame.h", no "../"), and libraries
// that have a home are included only there: GL and EGL in render/gl, SQLite in tiling/store, toml++ in
// config/detail and render/scene/detail (a scene is a TOML file too).
[[nodiscard]] std::vector<std::string> includeBreaches(const std::filesystem::path& root);

// A room's CMake libraries link no library of a room above it.
[[nodiscard]] std::vector<std::string> linkBreaches(const std::filesystem::path& root);

// Every bash script, known by its first line, is one that bash can parse, and may be executed.
[[nodiscard]] std::vector<std::string> scriptBreaches(const std::filesystem::path& root);

}  // namespace overfly::house
