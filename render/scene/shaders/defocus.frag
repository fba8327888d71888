uniform vec2 pupil;  // focal length in pixels times the pupil's diameter in metres, focus distance in metres
void main() {
  float radius = 0.5 * pupil.x * abs(1.0 / depthAt(pixel()) - 1.0 / pupil.y);  // of the circle of confusion, pixels
  vec3 sum = linearOf(here());
  float weight = 1.0;
  if (radius > 0.3) {
    vec2 texel = 1.0 / vec2(textureSize(picture, 0));
    for (int i = 1; i < 48; ++i) {
      float angle = 2.39996323 * float(i);
      vec2 q = radius * sqrt(float(i) / 47.5) * vec2(cos(angle), sin(angle));
      sum += linearOf(textureLod(picture, (gl_FragCoord.xy + q) * texel, 0.0).rgb);
      weight += 1.0;
    }
  }
  color = vec4(encodedOf(sum / weight), 1.0);
}
