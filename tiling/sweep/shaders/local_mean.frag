// Horizontal half of the local statistics of a luminance level: (mean, mean square) over 2 R + 1 columns.
uniform sampler2D luma;
uniform int level;
layout(location = 0) out vec2 moments;

void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy);
  int last = textureSize(luma, level).x - 1;
  vec2 sum = vec2(0.0);
  for (int i = -RADIUS; i <= RADIUS; ++i) {
    float value = texelFetch(luma, ivec2(clamp(texel.x + i, 0, last), texel.y), level).r;
    sum += vec2(value, value * value);
  }
  moments = sum / float(2 * RADIUS + 1);
}
