#pragma once
#include "capture/frame.h"
#include "config/error.h"

namespace overfly::capture {

// The same frame as a camera of fewer pixels would have taken it: `divide` (1, 2, 4, 8) times fewer columns
// and rows, decoded to Rgb8. Pixels in excess of a multiple of `divide` on the right and at the bottom are
// left out. Errors: decodeImage()'s; BadInput: another `divide`, nothing is left, or the image is
// smaller than its camera's. Reentrant.
[[nodiscard]] Result<FramePtr> reduced(const Frame& frame, int divide);

}  // namespace overfly::capture
