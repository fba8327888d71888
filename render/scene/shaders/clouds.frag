uniform mat3 scene_from_camera_rotation;
uniform vec3 camera_in_scene;
uniform vec3 towards_sun;
uniform vec4 clouds;  // threshold of the noise, share of light taken, size in metres, metres drifted east
uniform uint seed;
void main() {
  vec3 place = camera_in_scene + scene_from_camera_rotation * (rayAt(gl_FragCoord.xy) * depthAt(pixel()));
  vec2 p = place.xy - towards_sun.xy / towards_sun.z * place.z - vec2(clouds.w, 0.0);  // along the sun's rays
  float shade = smoothstep(-0.06, 0.06, octaves(p, 1.0, clouds.z, 0.05 * clouds.z, 0.5, seed) - clouds.x);
  color = vec4(encodedOf(linearOf(here()) * (1.0 - clouds.y * shade)), 1.0);
}
