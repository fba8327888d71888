// Texel (x, y) of a level becomes (p(x, y), p(x+1, y), p(x, y+1), p(x+1, y+1)): one fetch then holds all that
// a bilinear read needs.
layout(location = 0) out vec4 quad;
uniform sampler2D luma;
uniform int level;
void main() {
  ivec2 a = ivec2(gl_FragCoord.xy);
  ivec2 b = min(a + 1, textureSize(luma, level) - 1);
  quad = vec4(texelFetch(luma, a, level).r, texelFetch(luma, ivec2(b.x, a.y), level).r,
              texelFetch(luma, ivec2(a.x, b.y), level).r, texelFetch(luma, b, level).r);
}
