#pragma once
#include <Eigen/Core>
#include <vector>

#include "render/preview/view.h"

namespace overfly::preview {

// Where in the map, and how finely, a view looks: what the caches are filled after.
struct Focus {
  std::vector<Eigen::Vector2d> centres;  // by level: level-0 texels from the domain's corner
  Eigen::Vector2d motion{0, 0};          // of the centres since the last focus; zero at rest
  int finest = 0;                        // level that the nearest point seen calls for
  int coarsest = 0;                      // and the farthest
};

// Angle per pixel at the picture's middle, radians: metres of a texel that fills a pixel at 1 m.
[[nodiscard]] double pixelAngle(const View& view);
// log2 of the level-0 texels that a pixel covers at distance t is log2(t * this) (4.3)-(4.7), for a cell that
// is a cube: its three edges then span the same screen area whichever way they are turned. (The thesis takes
// the box's height over the height zero for the third edge, and so sees more detail on higher ground.)
[[nodiscard]] double levelsPerMetre(const View& view, const Domain& domain);

// The clip centre is where the picture's middle meets the ground plane (thesis, 4.2.2), but with the angle to
// straight down held below 70 deg. Each level's own centre lies on the line from the camera's foot through
// it, at the distance that the level is called for at, as near as the picture's lower edge and as far as the
// clip centre allows. `ground_m`: height of the plane, in the map's datum. The range of levels follows from
// rays through the picture's corners, edge middles and centre down to the plane (DVT, 3.3).
[[nodiscard]] Focus focusOf(const View& view, const RayFrame& frame, const Domain& domain, double ground_m);

}  // namespace overfly::preview
