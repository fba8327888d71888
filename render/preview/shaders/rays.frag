// A batch of rays, one a texel: for tests and for the position under a pixel's neighbours.
uniform highp sampler2D ray_starts;      // map coordinates relative to `start`
uniform highp sampler2D ray_directions;  // East-North-Up, unit length; w: levels of detail per metre
uniform mat3 per_metre;
uniform mat3 bend_x, bend_y, bend_z;
uniform vec3 start;
uniform float max_distance;

layout(location = 0) out uvec4 where;
layout(location = 1) out uvec4 how;

void main() {
  ivec2 i = ivec2(gl_FragCoord.xy);
  vec4 d = texelFetch(ray_directions, i, 0);
  vec3 bend = vec3(dot(d.xyz, bend_x * d.xyz), dot(d.xyz, bend_y * d.xyz), dot(d.xyz, bend_z * d.xyz));
  Ray ray = Ray(start + texelFetch(ray_starts, i, 0).xyz, per_metre * d.xyz, bend);
  Hit hit = traverse(ray, max_distance, 0.0, d.w);
  where = hit.found ? uvec4(floatBitsToUint(hit.position), floatBitsToUint(hit.t)) : uvec4(0u);
  how = uvec4(uint(hit.found), uint(hit.steps), uint(hit.found ? hit.level : 0), uint(hit.steps >= max_steps));
}
