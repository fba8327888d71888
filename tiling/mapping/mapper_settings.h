#pragma once
#include "config/settings.h"
#include "tiling/mapping/mapper.h"

namespace overfly::tiling {

// The mapper's own options from the settings: [sweep], map.tile_size, gpu.frame_cache_mb. The settings'
// defaults give MapperOptions' defaults, so that a map made with a command is the daemon's.
[[nodiscard]] MapperOptions mapperOptions(const config::Settings& settings);

// From [sweep] and map.gsd_m; the ground's height is not among the settings.
[[nodiscard]] GroundOptions groundOptions(const config::Settings& settings);

}  // namespace overfly::tiling
