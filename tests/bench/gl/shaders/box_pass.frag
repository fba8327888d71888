// One direction of a 7 x 7 box mean.
in vec2 uv;
uniform sampler2D source;
uniform ivec2 step_by;
layout(location = 0) out float result;
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  float sum = 0.0;
  for (int k = -3; k <= 3; ++k) sum += texelFetch(source, max(p + k * step_by, ivec2(0)), 0).r;
  result = sum * (1.0 / 7.0);
}
