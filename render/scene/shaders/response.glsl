// Light to albedo to camera, in the common subset of GLSL and C++ (noise.glsl).

// The simulated camera's response is a square root: encoded = sqrt(linear), 1 at saturation.
vec3 encoded(vec3 radiance) {
  return vec3(sqrt(clamp(radiance.x, 0.0f, 1.0f)), sqrt(clamp(radiance.y, 0.0f, 1.0f)), sqrt(clamp(radiance.z, 0.0f, 1.0f)));
}

// Sky from above and sun from towards_sun (unit); `lit` is the share of the sun that arrives.
vec3 radianceOf(vec3 albedo, vec3 normal, vec3 towards_sun, float lit) {
  float sun = max(dot(normal, towards_sun), 0.0f) * lit;
  float sky = 0.5f + 0.5f * normal.z;
  return albedo * (vec3(1.85f, 1.76f, 1.60f) * sun + vec3(0.38f, 0.44f, 0.54f) * (0.25f + 0.75f * sky));
}
