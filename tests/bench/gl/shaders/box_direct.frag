// 7 x 7 box mean by 49 reads.
in vec2 uv;
uniform sampler2D source;
layout(location = 0) out float result;
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  float sum = 0.0;
  for (int y = -3; y <= 3; ++y) {
    for (int x = -3; x <= 3; ++x) sum += texelFetch(source, max(p + ivec2(x, y), ivec2(0)), 0).r;
  }
  result = sum * (1.0 / 49.0);
}
