// Vertical half of the support window, then the best of the seven planes with a parabola through its
// neighbours. Output: height above the reference, score, index of the best plane (0..6), the texture
// strength that the score was divided by.
// With RAW the window sums are handed on instead (for path aggregation): seven planes and the strength.
uniform sampler2D first_in;
uniform sampler2D second_in;
#ifdef RAW
layout(location = 0) out vec4 first;
layout(location = 1) out vec4 second;
#else
uniform sampler2D base_height;
uniform float plane_step;
uniform float height_offset;
layout(location = 0) out vec4 best_out;
#endif

void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy);
  int last = textureSize(first_in, 0).y - 1;
  vec4 a = vec4(0.0), b = vec4(0.0);
  for (int i = -RADIUS; i <= RADIUS; ++i) {
    ivec2 p = ivec2(texel.x, clamp(texel.y + i, 0, last));
    a += texelFetch(first_in, p, 0);
    b += texelFetch(second_in, p, 0);
  }
  float scale = 1.0 / (float(2 * RADIUS + 1) * HALF_FLOAT_SCALE);
  a *= scale;
  b *= scale;
#ifdef RAW
  first = a;
  second = b;
#else
#if COST == 0
  float normalise = 1.0 / max(b.w, 1e-5);
#else
  float normalise = 1.0;
#endif
  float s[7] = float[7](a.x, a.y, a.z, a.w, b.x, b.y, b.z);
  int best = 3;
  for (int j = 0; j < 7; ++j)
    if (s[j] > s[best]) best = j;
  float offset = 0.0;
  if (best > 0 && best < 6) {
    float below = s[best - 1], above = s[best + 1];
    float curvature = below - 2.0 * s[best] + above;
    if (curvature < -1e-9) offset = clamp(0.5 * (below - above) / curvature, -0.5, 0.5);
  }
  best_out = vec4(texelFetch(base_height, texel, 0).r + height_offset + plane_step * (float(best - 3) + offset),
                  s[best] * normalise, float(best), 1.0 / normalise);
#endif
}
