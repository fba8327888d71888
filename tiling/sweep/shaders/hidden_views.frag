// Which views cannot see a texel: bit k of a whole number for view k. ON_SURFACE: the texels lie at
// `own_height`, which has the shape of the surface, else at their own base heights.
#ifdef ON_SURFACE
uniform sampler2D own_height;
#else
uniform sampler2D base_height;
uniform float height_offset;
#endif
uniform vec2 surface_from_texel;  // scale and offset: texture coordinates of a texel's centre
uniform vec2 grid_origin;         // s, t of a texel, see texel_rays.glsl
uniform float grid_step;
uniform vec3 ground[10];
uniform vec3 up[6];
uniform vec3 camera[VIEWS];  // in tile ENU
uniform float rim, clearance, share;  // see isHidden()
layout(location = 0) out vec4 hidden_out;

void main() {
  vec2 at = gl_FragCoord.xy * surface_from_texel.x + surface_from_texel.y;
  float hidden = 0.0;
#ifdef ON_SURFACE
  float z = textureLod(own_height, at, 0.0).r;
#else
  float z = texelFetch(base_height, ivec2(gl_FragCoord.xy), 0).r + height_offset;
#endif
  float s = grid_origin.x + gl_FragCoord.x * grid_step, t = grid_origin.y + gl_FragCoord.y * grid_step;
  vec3 point = ground[0] + s * (ground[1] + s * ground[3] + t * ground[4]) + t * (ground[2] + t * ground[5]);
  point += z * up[0];
  for (int k = 0; k < VIEWS; ++k)
    if (isHidden(at, z, point, camera[k], rim, clearance, share)) hidden += float(1 << k);
  hidden_out = vec4(hidden);
}
