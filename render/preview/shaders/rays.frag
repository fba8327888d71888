// A batch of single rays, each of four texels side by side, all of them bits of floats save for the cell: for
// tests and for the place under a pixel.
uniform highp usampler2D rays;
uniform float max_distance;

layout(location = 0) out uvec4 where;
layout(location = 1) out uvec4 how;

void main() {
  ivec2 i = ivec2(gl_FragCoord.xy) * ivec2(4, 1);
  uvec4 begin = texelFetch(rays, i, 0);  // cell, fraction
  vec4 along = uintBitsToFloat(texelFetch(rays, i + ivec2(1, 0), 0));  // and the height
  vec4 rest = uintBitsToFloat(texelFetch(rays, i + ivec2(2, 0), 0));   // what float cut off of these four
  vec4 bend = uintBitsToFloat(texelFetch(rays, i + ivec2(3, 0), 0));   // and the levels per metre
  Ray ray = Ray(ivec2(begin.xy), uintBitsToFloat(begin.zw), vec2(along.w, rest.w), along.xyz, rest.xyz, bend.xyz);
  reportHit(traverse(ray, max_distance, 0.0, bend.w), where, how);
}
