// Sun and its shadows, for the surfaces' fragment stages.
uniform vec3 towards_sun;
#ifdef SUN_SHADOWS
uniform highp sampler2D shadow_map;      // depth towards the sun, 0..1
uniform mat3 light_from_scene_rotation;
uniform vec3 light_scale;                // texel and depth coordinates = scale * rotated + offset
uniform vec3 light_offset;
uniform float shadow_texel_metres;
float litShare(vec3 place, vec3 n) {
  vec3 q = light_scale * (light_from_scene_rotation * (place + n * (1.2 * shadow_texel_metres))) + light_offset;
  // Bilinear over four hard comparisons. The gather is asked for at the corner between the four texels, where
  // no rounding of its coordinates can pick others.
  vec2 t = q.xy - 0.5;
  vec2 f = t - floor(t);
  vec4 d = textureGather(shadow_map, (floor(t) + 1.0) / vec2(textureSize(shadow_map, 0)));
  vec4 lit = step(vec4(q.z), d);
  return mix(mix(lit.w, lit.z, f.x), mix(lit.x, lit.y, f.x), f.y);
}
#else
float litShare(vec3 place, vec3 n) { return 1.0; }
#endif
#ifdef SPECULAR
uniform vec3 eye;                // camera in the scene
uniform vec3 specular;           // strength, roughness of water, time in seconds
// The sun mirrored by a surface of tangent slopes with the given roughness (Beckmann), times Fresnel.
float glint(vec3 place, vec3 n, float roughness, float lit) {
  vec3 h = normalize(normalize(eye - place) + towards_sun);
  float c = max(dot(n, h), 1e-3);
  float tan2 = 1.0 / (c * c) - 1.0;
  float fresnel = 0.02 + 0.98 * pow(1.0 - max(dot(h, towards_sun), 0.0), 5.0);
  return lit * specular.x * fresnel * 12.0 * exp(-tan2 / (roughness * roughness)) / (c * c * c * c);
}
// Waves of water: the normal of a moving surface.
vec3 waveNormal(vec2 p, float width) {
  vec2 drift = vec2(0.9, 0.5) * specular.z;
  float e = max(0.05, width);
  float a = octaves(p + drift, width, 1.6, 0.05, 0.6, 0x2545f491u);
  float ax = octaves(p + drift + vec2(e, 0.0), width, 1.6, 0.05, 0.6, 0x2545f491u);
  float ay = octaves(p + drift + vec2(0.0, e), width, 1.6, 0.05, 0.6, 0x2545f491u);
  return normalize(vec3((a - ax) / e * 0.12, (a - ay) / e * 0.12, 1.0));
}
#endif
