// Crowns of leaves: what a foliage polygon shows at a place, compiled twice like material.glsl, after it.

// How far inside the clump a place is: drawn where it is positive. uv in [-1, 1] on the polygon; `metres` is
// half the polygon's side, so that leaves have one size whatever the crown's.
float leafCover(vec2 uv, float metres, uint clump) {
  vec2 p = uv * metres;
  float rough = 0.62f * valueNoise(p * 1.9f, clump) + 0.46f * valueNoise(p * 5.3f, clump + 1u);
  return 1.0f - dot(uv, uv) + 0.75f * (rough - 0.15f);
}

// Linear albedo. `depth` is 0 at the bottom of the crown and 1 at its top: light falls off inside.
vec3 leafAlbedo(uint species, uint plant_seed, vec2 uv, float metres, float depth, float width, uint clump) {
  vec2 p = uv * metres;
  float fine = octaves(p, width, 0.55f, 0.018f, 0.86f, clump + 7u);
  float pick = unitOf(mixBits(plant_seed + 21u));
  vec3 colour = mix(vec3(0.060f, 0.105f, 0.022f), vec3(0.120f, 0.150f, 0.038f), pick);
  if (species == 2u) {
    colour = mix(vec3(0.026f, 0.060f, 0.026f), vec3(0.050f, 0.085f, 0.034f), pick);
  }
  if (species == 3u) {
    colour = mix(vec3(0.090f, 0.125f, 0.035f), vec3(0.170f, 0.160f, 0.060f), pick);
  }
  float inside = 0.42f + 0.58f * depth * depth;
  return colour * (inside * max(1.0f + 1.5f * fine, 0.12f));
}
