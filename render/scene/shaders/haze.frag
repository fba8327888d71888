uniform float extinction;  // per metre (Koschmieder: 3.912 / visibility)
void main() {
  float kept = exp(-extinction * depthAt(pixel()) * length(rayAt(gl_FragCoord.xy)));
  color = vec4(encodedOf(mix(vec3(0.62, 0.68, 0.75), linearOf(here()), kept)), 1.0);
}
