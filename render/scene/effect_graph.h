#pragma once
#include <string>
#include <vector>

#include "render/scene/effect_settings.h"

namespace overfly::scene {

// What a scene's effects compile to: one node for the geometry and one or more for each named effect, in
// order. Nothing else exists at run time. Value type.
struct GraphNode {
  enum class Kind {
    Geometry,  // the one pass that every frame has
    Variant,   // changes how geometry is drawn, adds no pass
    Target,    // a render target of its own before the geometry (the shadow map)
    Pass,      // one full-screen pass over the picture
    Encoding,  // on the CPU, after the picture is read back
    Pose,      // changes the pose that goes with the frame
    Stream,    // changes which frames are handed on and when
  };
  Kind kind = Kind::Geometry;
  std::string name;     // the effect's, or "geometry"
  std::string meaning;  // for --explain
};

[[nodiscard]] std::vector<GraphNode> compileGraph(const std::vector<EffectSettings>& effects);
[[nodiscard]] GraphNode::Kind kindOf(Effect effect);
[[nodiscard]] const char* nameOf(GraphNode::Kind kind);

}  // namespace overfly::scene
