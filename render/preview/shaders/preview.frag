// One pixel of a preview. What the view does not call for is not compiled in: SURFACE, FILTER, MODE (0 colour,
// 1 elevation, 2 quality, 3 age, 4 level), SHADOWS, PATCH, PROJECTORS (their number), HITS.
uniform mat3 enu_from_camera;
uniform vec3 camera;       // focal length and centre, pixels
uniform vec2 start;        // the camera within origin_cell
uniform vec2 start_height; // a sum
uniform float lod_per_metre;  // levels of detail: 0 for the finest everywhere
uniform float max_distance;
uniform vec3 sky_low, sky_high, nothing;

layout(location = 0) out vec4 color;
#ifdef HITS
layout(location = 1) out uvec4 where;
layout(location = 2) out uvec4 how;
#endif

void main() {
  vec3 ahead = vec3((gl_FragCoord.xy - camera.yz) / camera.x, 1.0);
  float stretch = length(ahead);
  vec3 direction = enu_from_camera * (ahead / stretch);
  Ray ray = Ray(origin_cell, start, start_height, per_metre * direction, vec3(0.0), curve(direction));
  Hit hit = traverse(ray, max_distance, 0.0, lod_per_metre);
#ifdef HITS
  reportHit(hit, where, how);
#endif
  if (!hit.found) {
    float up = clamp(direction.z, 0.0, 1.0);
    vec3 sky = mix(sky_low, sky_high, sqrt(up));
    color = vec4(direction.z < 0.0 ? mix(sky_low, nothing, smoothstep(0.0, 0.06, -direction.z)) : sky, 1.0);
    return;
  }
  vec2 slope = slopeAt(hit);
  vec3 normal = normalAt(hit, slope, ray.along);
  bool wall = hit.at_entry && hit.entered != 0;
  float finest = float(hit.level) + hit.tau;
#if SHADOWS || PROJECTORS > 0
  // Where secondary rays begin, clear of the surface that they leave.
  float lift = 0.6 * texel_metres * power2(hit.level) + 1e-4 * hit.t;
  vec3 above = hit.fraction + per_metre * (normal * lift);
#endif
  vec3 shown = vec3(0.62, 0.62, 0.60);
#if MODE == 0
  // The pixel's neighbours on the tangent plane.
  mat3 to_map = per_metre * enu_from_camera;
  vec3 dx = to_map * vec3(1.0, 0.0, 0.0), dy = to_map * vec3(0.0, 1.0, 0.0);
  float depth = hit.t / (stretch * camera.x);
  float facing = ray.along.z - dot(slope, ray.along.xy);
  if (abs(facing) < 0.02) facing = facing < 0.0 ? -0.02 : 0.02;
  vec2 px = depth * (dx.xy - ray.along.xy * ((dx.z - dot(slope, dx.xy)) / facing));
  vec2 py = depth * (dy.xy - ray.along.xy * ((dy.z - dot(slope, dy.xy)) / facing));
  if (wall) {
    px = vec2(power2(hit.level), 0.0);
    py = px.yx;
  }
  vec4 sampled = filteredColor(positionOf(hit), px, py, lod_per_metre > 0.0 ? floor(finest) - 1.0 : 0.0);
  if (sampled.a > 0.02) shown = sampled.rgb / sampled.a;
#if PROJECTORS > 0
  float side = 1.0 - smoothstep(lateral.y, lateral.x, normal.z);
  if (side > 0.0) {
    vec4 projected = projectedColor(hit, direction, normal, above, finest);
    shown = mix(shown, projected.rgb, side * projected.a);
  }
#endif
#elif MODE == 1
  shown = ramp((hit.fraction.z - value_range.x) / max(value_range.y - value_range.x, 1e-3));
#elif MODE == 2
  shown = ramp(1.0 - qualityAt(hit.level, hit.cell, hit.slot).r);
#elif MODE == 3
  shown = hit.level >= top_level ? vec3(0.5)
        : ramp(float(texelFetch(slots, ivec2((hit.cell >> TILE_LOG2) - ivec2(window[hit.level].xy)) +
                                ivec2(0, hit.level * table_stride), 0).g) / 255.0);
#else
  shown = ramp(float(hit.level) / 8.0);
#endif
#if PATCH
  if (qualityAt(hit.level, hit.cell, hit.slot).g == 0.0)
    shown = mod(gl_FragCoord.x + gl_FragCoord.y, 10.0) < 5.0 ? vec3(0.55, 0.5, 0.55) : vec3(0.42, 0.38, 0.42);
#endif
  bool lit = true;
#if SHADOWS
  Ray to_sun = Ray(hit.place, above.xy, vec2(above.z, 0.0), per_metre * sun, vec3(0.0), curve(sun));
  lit = !traverse(to_sun, max_distance, finest, 0.0).found;
#endif
  color = vec4(clamp(shown * lightOn(normal, lit), 0.0, 1.0), 1.0);
}
