#pragma once
#include <cstdint>
#include <vector>

#include "config/error.h"
#include "render/scene/ray_tracer.h"

namespace overfly::scene {

// The picture as a baseline JPEG, chroma at half size in both directions or at full size. Reentrant.
[[nodiscard]] Result<std::vector<std::uint8_t>> encodeJpeg(const Picture& picture, int quality,
                                                           bool half_chroma);

}  // namespace overfly::scene
