// Which views cannot see a texel at its base height, because a coarser surface stands in between: bit k of a
// whole number for view k. Marches from the texel to each camera until above everything.
uniform sampler2D surface;        // heights of the coarser grid above the reference
uniform sampler2D base_height;
uniform float height_offset;
uniform vec2 surface_from_texel;  // scale and offset: texture coordinates of a texel's centre
uniform vec4 surface_from_enu;    // 2x2, columns: texture coordinates per metre east, north
uniform vec2 grid_origin;         // s, t of a texel, see texel_rays.glsl
uniform float grid_step;
uniform vec3 ground[10];
uniform vec3 up[6];
uniform vec3 camera[VIEWS];  // in tile ENU
uniform float highest;       // of the surface
uniform float march_step;    // metres: a texel of the surface
uniform float clearance;     // metres by which the surface must stand above the ray
layout(location = 0) out vec4 hidden_out;

bool isHidden(vec2 at, float z, vec3 point, vec3 eye) {
  vec3 ray = eye - point;
  float rise = highest - z - clearance;
  if (rise <= 0.0 || ray.z <= 0.0) return false;
  vec2 run = ray.xy / ray.z;  // metres sideways per metre up
  float sideways = length(run) * rise;
  float steps = clamp(ceil(sideways / march_step), 1.0, 48.0);
  vec2 along = mat2(surface_from_enu.xy, surface_from_enu.zw) * run;
  // The texel's own rim, as wide as the coarser grid knows it, does not hide it.
  for (float i = 1.0; i <= steps; i += 1.0) {
    float rise_here = rise * i / steps;
    if (length(run) * rise_here < 1.5 * march_step) continue;
    if (textureLod(surface, at + along * rise_here, 0.0).r > z + rise_here + clearance) return true;
  }
  return false;
}

void main() {
  float base = texelFetch(base_height, ivec2(gl_FragCoord.xy), 0).r;
  float hidden = 0.0;
  if (base > SKIP_BELOW) {
    float z = base + height_offset;
    float s = grid_origin.x + gl_FragCoord.x * grid_step, t = grid_origin.y + gl_FragCoord.y * grid_step;
    vec3 point = ground[0] + s * (ground[1] + s * ground[3] + t * ground[4]) + t * (ground[2] + t * ground[5]);
    point += z * up[0];
    vec2 at = gl_FragCoord.xy * surface_from_texel.x + surface_from_texel.y;
    for (int k = 0; k < VIEWS; ++k)
      if (isHidden(at, z, point, camera[k])) hidden += float(1 << k);
  }
  hidden_out = vec4(hidden);
}
