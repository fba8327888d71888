// Whether a surface stands between a point and a camera: a march along the line of sight, texel by texel, that
// leaves out stretches above the ceiling.
// STRETCH: texels, the block of ceilingOf().
#define LONGEST_PATH 256.0      // texels: what is further away hides nothing
uniform sampler2D surface;      // heights above the reference, square, nearest
uniform sampler2D ceiling;      // highest of the surface in and around blocks of STRETCH squared texels
uniform vec4 surface_from_enu;  // 2x2, columns: texture coordinates per metre east, north
uniform float highest;          // of the surface
uniform float march_step;       // metres: a texel of the surface

// `at`: the point in texture coordinates of the surface. The surface hides it where it stands more than
// `clearance` metres, and that share of the height gained, above the ray. What is nearer than `rim` texels does
// not hide it: the point's own edge, as wide as the surface knows it.
bool isHidden(vec2 at, float z, vec3 point, vec3 eye, float rim, float clearance, float share) {
  vec3 ray = eye - point;
  float rise = highest - z - clearance;
  if (rise <= 0.0 || ray.z <= 0.0) return false;
  vec2 run = ray.xy / ray.z;  // metres sideways per metre up
  float slope = length(run);
  float path = min(slope * rise / march_step, LONGEST_PATH);
  float up = march_step / max(slope, 1e-6);  // metres per texel of the path
  vec2 along = mat2(surface_from_enu.xy, surface_from_enu.zw) * run * up;
  float blocks = float(textureSize(surface, 0).x) / STRETCH;
  ivec2 last = textureSize(ceiling, 0) - 1;
  for (float from = rim; from <= path; from += STRETCH) {
    ivec2 block = clamp(ivec2((at + along * (from + 0.5 * STRETCH - 0.5)) * blocks), ivec2(0), last);
    if (texelFetch(ceiling, block, 0).r <= z + clearance + from * up * (1.0 + share)) continue;
    for (float i = from; i < from + STRETCH; i += 1.0)
      if (textureLod(surface, at + along * i, 0.0).r > z + clearance + i * up * (1.0 + share)) return true;
  }
  return false;
}
