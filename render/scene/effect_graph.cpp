#include "render/scene/effect_graph.h"

namespace overfly::scene {

GraphNode::Kind kindOf(Effect effect) {
  using Kind = GraphNode::Kind;
  switch (effect) {
    case Effect::WindSway:
    case Effect::Vehicles:
    case Effect::Specular:
    case Effect::RollingShutter:
      return Kind::Variant;
    case Effect::SunShadows:
      return Kind::Target;
    case Effect::CloudShadows:
    case Effect::Haze:
    case Effect::Defocus:
    case Effect::MotionBlur:
    case Effect::LensDistortion:
    case Effect::Vignetting:
    case Effect::ExposureDrift:
    case Effect::SensorNoise:
      return Kind::Pass;
    case Effect::Jpeg:
      return Kind::Encoding;
    case Effect::GnssNoise:
    case Effect::AttitudeNoise:
    case Effect::Mounting:
    case Effect::TimeDelay:
    case Effect::DroppedPoses:
      return Kind::Pose;
    case Effect::DroppedFrames:
      return Kind::Stream;
  }
  return Kind::Stream;
}

const char* nameOf(GraphNode::Kind kind) {
  switch (kind) {
    case GraphNode::Kind::Geometry:
      return "geometry";
    case GraphNode::Kind::Variant:
      return "variant of the geometry";
    case GraphNode::Kind::Target:
      return "render target";
    case GraphNode::Kind::Pass:
      return "pass";
    case GraphNode::Kind::Encoding:
      return "encoding";
    case GraphNode::Kind::Pose:
      return "pose";
    case GraphNode::Kind::Stream:
      return "stream";
  }
  return "";
}

std::vector<GraphNode> compileGraph(const std::vector<EffectSettings>& effects) {
  std::vector<GraphNode> graph;
  const auto add = [&](GraphNode::Kind kind) {
    for (const EffectInfo& info : allEffects()) {
      if (findEffect(effects, info.effect) && kindOf(info.effect) == kind) {
        graph.push_back({kind, std::string(info.name), std::string(info.meaning)});
      }
    }
  };
  add(GraphNode::Kind::Target);
  graph.push_back({GraphNode::Kind::Geometry, "geometry", "ground, solids and plants, four samples a pixel"});
  for (const auto kind : {GraphNode::Kind::Variant, GraphNode::Kind::Pass, GraphNode::Kind::Encoding,
                          GraphNode::Kind::Pose, GraphNode::Kind::Stream})
    add(kind);
  return graph;
}

}  // namespace overfly::scene
