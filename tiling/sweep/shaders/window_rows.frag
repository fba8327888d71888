// Horizontal half of the support window: mean over 2 R + 1 columns of all seven planes and the strength.
uniform sampler2D first_in;
uniform sampler2D second_in;
layout(location = 0) out vec4 first;
layout(location = 1) out vec4 second;

void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy);
  int last = textureSize(first_in, 0).x - 1;
  vec4 a = vec4(0.0), b = vec4(0.0);
  for (int i = -RADIUS; i <= RADIUS; ++i) {
    ivec2 p = ivec2(clamp(texel.x + i, 0, last), texel.y);
    a += texelFetch(first_in, p, 0);
    b += texelFetch(second_in, p, 0);
  }
  first = a / float(2 * RADIUS + 1);
  second = b / float(2 * RADIUS + 1);
}
