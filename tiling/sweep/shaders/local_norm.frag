// Vertical half, and the locally normalised value: (luma - mean) / sqrt(variance + noise^2), coded around
// 128/255 with CODE_SCALE steps per standard deviation; 0 is kept for pixels outside the valid image.
uniform sampler2D luma;
uniform sampler2D moments;
uniform sampler2D color;  // alpha: validity of the rectified frame
uniform int level;
uniform float noise;
layout(location = 0) out vec4 normalised;

void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy);
  ivec2 size = textureSize(luma, level);
  vec2 sum = vec2(0.0);
  for (int i = -RADIUS; i <= RADIUS; ++i)
    sum += texelFetch(moments, ivec2(texel.x, clamp(texel.y + i, 0, size.y - 1)), 0).rg;
  sum /= float(2 * RADIUS + 1);
  float deviation = sqrt(max(sum.y - sum.x * sum.x, 0.0) + noise * noise);
  float value = (texelFetch(luma, texel, level).r - sum.x) / deviation;
  vec2 uv = (vec2(texel) + 0.5) / vec2(size);
  bool valid = textureLod(color, uv, 0.0).a > 0.5;
  normalised = vec4(valid ? clamp((128.0 + CODE_SCALE * value) / 255.0, 1.0 / 255.0, 1.0) : 0.0);
}
