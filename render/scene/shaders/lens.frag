// OpenCV's radial-tangential lens: where the ideal picture, which is wider than the sensor, shows what this
// pixel of the sensor sees.
uniform vec4 sensor;         // fx, fy, cx, cy in pixels
uniform vec4 ideal;          // of the ideal picture
uniform float distortion[5]; // k1 k2 p1 p2 k3
vec2 distorted(vec2 q) {
  float r2 = dot(q, q);
  float radial = 1.0 + r2 * (distortion[0] + r2 * (distortion[1] + r2 * distortion[4]));
  return q * radial + vec2(2.0 * distortion[2] * q.x * q.y + distortion[3] * (r2 + 2.0 * q.x * q.x),
                           distortion[2] * (r2 + 2.0 * q.y * q.y) + 2.0 * distortion[3] * q.x * q.y);
}
vec3 at(ivec2 p) { return texelFetch(picture, clamp(p, ivec2(0), textureSize(picture, 0) - 1), 0).rgb; }
void main() {
  vec2 target = (gl_FragCoord.xy - sensor.zw) / sensor.xy;
  vec2 q = target;
  for (int i = 0; i < 14; ++i) q += target - distorted(q);
  // Catmull-Rom over 4 x 4 texels.
  vec2 p = q * ideal.xy + ideal.zw - 0.5;
  ivec2 i = ivec2(floor(p));
  vec2 t = p - floor(p);
  vec4 wx = vec4(((-0.5 * t.x + 1.0) * t.x - 0.5) * t.x, (1.5 * t.x - 2.5) * t.x * t.x + 1.0,
                 ((-1.5 * t.x + 2.0) * t.x + 0.5) * t.x, (0.5 * t.x - 0.5) * t.x * t.x);
  vec4 wy = vec4(((-0.5 * t.y + 1.0) * t.y - 0.5) * t.y, (1.5 * t.y - 2.5) * t.y * t.y + 1.0,
                 ((-1.5 * t.y + 2.0) * t.y + 0.5) * t.y, (0.5 * t.y - 0.5) * t.y * t.y);
  vec3 sum = vec3(0.0);
  for (int k = 0; k < 4; ++k) {
    sum += wy[k] * (wx.x * at(i + ivec2(-1, k - 1)) + wx.y * at(i + ivec2(0, k - 1)) + wx.z * at(i + ivec2(1, k - 1)) + wx.w * at(i + ivec2(2, k - 1)));
  }
  color = vec4(clamp(sum, 0.0, 1.0), 1.0);
}
