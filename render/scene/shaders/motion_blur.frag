uniform vec3 velocity;   // of the camera in its axes, times the exposure: metres
uniform vec3 rotation;   // radians
void main() {
  vec3 ray = rayAt(gl_FragCoord.xy);
  vec3 p = ray * depthAt(pixel());
  vec3 moved = -(velocity + cross(rotation, p));          // of the point in camera axes
  vec2 streak = lens.xy * (moved.xy - ray.xy * moved.z) / p.z;  // pixels over the exposure
  int taps = clamp(int(ceil(2.0 * length(streak))) + 1, 1, 48);
  vec2 texel = 1.0 / vec2(textureSize(picture, 0));
  vec3 sum = vec3(0.0);
  for (int i = 0; i < taps; ++i) {
    vec2 q = ((float(i) + 0.5) / float(taps) - 0.5) * streak;
    sum += linearOf(textureLod(picture, (gl_FragCoord.xy + q) * texel, 0.0).rgb);
  }
  color = vec4(encodedOf(sum / float(taps)), 1.0);
}
