// How a point of the surface looks.
uniform mat3 per_metre;       // map coordinates per metre of East-North-Up at the camera
uniform mat3 bend_x, bend_y, bend_z;
uniform vec3 sun;             // East-North-Up, unit length
uniform float relief;         // 0: colours as they are; 1: lit by the sun alone
uniform float texel_metres;   // of level 0
uniform vec2 value_range;     // of the false colours

// Second order of a straight line in the map's coordinates.
vec3 curve(vec3 d) { return vec3(dot(d, bend_x * d), dot(d, bend_y * d), dot(d, bend_z * d)); }

const float AMBIENT = 0.45;

// Slope of the surface at a hit, height per level-0 texel.
vec2 slopeAt(Hit hit) {
#if SURFACE == 0
  return vec2(0.0);
#else
  float h[9];
  neighbourhood(heightPlace(hit.level, hit.cell, hit.slot), h);
  vec2 slope = smoothSlope(h, hit.local) * power2(-hit.level);
  if (hit.tau > 0.0) {
    neighbourhood(parentPlace(hit.level, hit.cell), h);
    vec2 coarse = smoothSlope(h, 0.5 * (vec2(hit.cell & 1) + hit.local)) * power2(-hit.level - 1);
    slope = mix(slope, coarse, hit.tau);
  }
  return slope;
#endif
}

// A wall stands where the ray comes into a cell below its surface.
vec3 normalAt(Hit hit, vec2 slope, vec3 along) {
  if (hit.at_entry && hit.entered != 0) {
#if SURFACE == 0
    if (hit.entered == 1) return vec3(along.x > 0.0 ? -1.0 : 1.0, 0.0, 0.0);
    return vec3(0.0, along.y > 0.0 ? 1.0 : -1.0, 0.0);
#else
    // Such surfaces have walls only where the map ends and around holes. Which side of a texel a pixel shows
    // changes from one to the next there, and a shade after it would be speckle: they face the camera.
    vec2 back = along.xy / max(abs(along.x), abs(along.y));
    return normalize(vec3(-back.x, back.y, 0.0));
#endif
  }
  return normalize(vec3(-slope.x / texel_metres, slope.y / texel_metres, 1.0));
}

// Blue, cyan, green, yellow, red.
vec3 ramp(float x) {
  x = 4.0 * clamp(x, 0.0, 1.0);
  return clamp(vec3(x - 2.0, x < 2.0 ? x : 4.0 - x, 2.0 - x), 0.0, 1.0) * 0.75 + 0.15;
}

float lightOn(vec3 normal, bool lit) {
  float direct = lit ? max(dot(normal, sun), 0.0) / max(sun.z, 0.25) : 0.0;
  return mix(1.0, min(AMBIENT + (1.0 - AMBIENT) * direct, 1.4), relief);
}
