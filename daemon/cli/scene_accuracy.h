#pragma once
#include <string>

#include "config/error.h"
#include "daemon/cli/command.h"
#include "tiling/mapping/batch_map.h"

namespace overfly::cli {

struct SceneAccuracyOptions {
  std::string scene;         // file, or the name of one that ships
  std::string effects;       // comma-separated instead of the scene's own; "none"; empty: the scene's own
  bool each_effect = false;  // also without each of its effects, and without any
  int reduce = 1;            // pictures of so many times fewer columns and rows
  int frames = 0;            // only the first so many; 0: all
  bool table = false;        // rows of docs/accuracy.md's table instead of the long form
  bool json = false;
};

// Renders a scene's flight, maps it and compares the map with the scene's truth; prints a row per set of
// effects. Returns an exit status.
[[nodiscard]] Result<int> sceneAccuracy(const SceneAccuracyOptions& options,
                                        const tiling::BatchOptions& mapping, const Context& context);

}  // namespace overfly::cli
