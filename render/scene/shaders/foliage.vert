layout(location = 0) in vec2 corner;        // -1 or 1
layout(location = 1) in vec3 centre;        // of the polygon, in crown units (foliage.h)
layout(location = 2) in vec3 u_axis;
layout(location = 3) in vec3 v_axis;
layout(location = 4) in vec3 polygon_normal;
layout(location = 5) in uint polygon;
layout(location = 6) in vec4 foot_height;   // east, north, up, height
layout(location = 7) in vec2 radius_turn;
layout(location = 8) in uvec2 species_seed;
#ifdef WIND_SWAY
uniform vec3 wind;  // radians of phase, amplitude in metres, and phase per metre east
#endif
out vec3 place;
out vec2 uv;
out float depth_in_crown;
flat out vec3 normal;
flat out float metres;
flat out uvec2 plant;
flat out uint clump;

vec3 turned(vec3 p) {
  float c = cos(radius_turn.y);
  float s = sin(radius_turn.y);
  return vec3(c * p.x - s * p.y, s * p.x + c * p.y, p.z);
}

void main() {
  vec3 size = vec3(radius_turn.x, radius_turn.x, foot_height.w);
  vec3 local = centre + corner.x * u_axis + corner.y * v_axis;
  place = foot_height.xyz + turned(local * size);
#ifdef WIND_SWAY
  float phase = wind.x + wind.z * foot_height.x + float(species_seed.y & 1023u) * 0.0061359;
  float lean = wind.y * local.z * local.z;
  place += lean * vec3(sin(phase), 0.6 * sin(1.37 * phase + 1.0), 0.0);
#endif
  uv = corner;
  depth_in_crown = local.z;
  normal = turned(polygon_normal);
  metres = radius_turn.x * length(u_axis);
  plant = species_seed;
  clump = species_seed.y + polygon * 0x9e3779b1u;
#ifdef SHADOW_MAP
  gl_Position = lightClipOf(place);
#else
  gl_Position = clipOf(cameraFromScene(place));
#endif
}
