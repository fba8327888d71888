#pragma once
#include "render/preview/surface.h"
#include "render/preview/tile_image.h"

namespace overfly::preview {

enum class Filter { Nearest, Bilinear, Trilinear, Anisotropic };
// What the surface's colour says.
enum class Mode { Color, Elevation, Quality, Age, Level };

// How a preview looks. Each entry is compiled into the shader only when a picture calls for it.
struct Look {
  Surface surface = Surface::Linear;
  Filter filter = Filter::Anisotropic;
  int max_anisotropy = 4;  // samples along the longer side of a pixel's footprint
  Mode mode = Mode::Color;
  NoData no_data = NoData::Hole;
  bool shadows = false;
  double relief = 0.4;         // 0: colours as they are; 1: shaded by the sun alone
  double sun_heading = 5.498;  // where the sun stands, radians: north-west
  double sun_height = 0.785;
  // Steep sides take their colour from so many photographs at most (thesis, chapter 6), 0 to
  // ProjectorTextures::kMost; more show more sides and cost a ray each where they do not.
  int projectors = 0;
  double projector_angle = 0.78539816;  // largest between a photograph's viewing direction and this view's
  // A photograph that sees a place at a lower angle than this to the surface (radians) colours it only where
  // no other does; 0: the one taken nearest does always, as in the thesis.
  double projector_grazing = 0.2;
  double lateral_slope = 0.78539816;  // from which a surface is a side, radians; 0: everything is
  // Levels coarser than a pixel's footprint are drawn where this is on (l_opt of 4.2.3); the finest
  // everywhere where it is off.
  bool level_of_detail = true;
};

}  // namespace overfly::preview
