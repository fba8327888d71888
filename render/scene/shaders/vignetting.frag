uniform vec4 sensor;      // fx, fy, cx, cy in pixels
uniform float strength;
void main() {
  vec2 q = (gl_FragCoord.xy - sensor.zw) / sensor.xy;
  float cos2 = 1.0 / (1.0 + dot(q, q));
  color = vec4(encodedOf(linearOf(here()) * pow(cos2, 2.0 * strength)), 1.0);
}
