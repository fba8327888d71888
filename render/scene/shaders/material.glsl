// What surfaces look like: linear albedo as a function of place; after noise.glsl, in the same common subset
// of GLSL and C++. Texture is filtered over the pixel's footprint, and nothing repeats unless a material is a
// man-made grid.

// --- the ground ------------------------------------------------------------------------------------------

// Signed distances in metres, positive inside; classes and codes as in cover.h.
struct Cover {
  float street;
  float paved;
  float bed;
  uint base;
};

float coverDistance(uint texel, int shift) { return (float((texel >> uint(shift)) & 255u) - 128.0f) * 0.03125f; }

// Only the base of the texel that holds the place.
uint baseAt(vec2 p) {
  vec2 q = (p - coverOrigin()) * coverTexelsPerMetre();
  return coverTexel(int(floor(q.x)), int(floor(q.y))) >> 24;
}

// Distances farther outside than `margin` (metres; streets: beyond the kerb) come as those of the texel that
// holds the place: the nearest four differ from it by less than two texels, and that far out all mean the same.
Cover coverAt(vec2 p, float margin) {
  vec2 q = (p - coverOrigin()) * coverTexelsPerMetre();
  uint own = coverTexel(int(floor(q.x)), int(floor(q.y)));
  Cover r;
  r.street = coverDistance(own, 0);
  r.paved = coverDistance(own, 8);
  r.bed = coverDistance(own, 16);
  r.base = own >> 24;
  // Loops of one turn at most, here and below: where no pixel of a group needs them they are left out, which a
  // software rasteriser does for loops and not for branches.
  float nearest = max(max(r.street + kerbWidth(), r.paved), r.bed) + 2.0f / coverTexelsPerMetre();
  for (int once = 0; once < (nearest > -margin ? 1 : 0); ++once) {
    float gx = q.x - 0.5f;
    float gy = q.y - 0.5f;
    float fx = floor(gx);
    float fy = floor(gy);
    int ix = int(fx);
    int iy = int(fy);
    float tx = gx - fx;
    float ty = gy - fy;
    uint a = coverTexel(ix, iy);
    uint b = coverTexel(ix + 1, iy);
    uint c = coverTexel(ix, iy + 1);
    uint d = coverTexel(ix + 1, iy + 1);
    r.street = mix(mix(coverDistance(a, 0), coverDistance(b, 0), tx), mix(coverDistance(c, 0), coverDistance(d, 0), tx), ty);
    r.paved = mix(mix(coverDistance(a, 8), coverDistance(b, 8), tx), mix(coverDistance(c, 8), coverDistance(d, 8), tx), ty);
    r.bed = mix(mix(coverDistance(a, 16), coverDistance(b, 16), tx), mix(coverDistance(c, 16), coverDistance(d, 16), tx), ty);
  }
  return r;
}

float areaOf(float distance, float soft) { return smoothstep(-soft, soft, distance); }

// Linear albedo of the ground at (east, north).
vec3 groundAlbedo(vec2 p, float width) {
  float coarse = octaves(p, width, 23.0f, 0.7f, 0.78f, 0x1000193u);
  float fine = 0.8f * octaves(p, width, 0.45f, 0.011f, 0.92f, 0x811c9dc5u);
  float edge = 0.25f * valueNoise(p * 1.7f, 0x51ed270bu) + 0.1f * fine;  // borders of parcels are ragged
  uint base = baseAt(p + vec2(edge, -edge) * 1.6f);
  float soft = max(0.5f * width, 0.012f);
  Cover here = coverAt(p, soft + 0.15f * abs(edge));

  // Nature: two colours mixed by the coarse noise, modulated by the fine one; rows where a field has them.
  vec3 low = vec3(0.055f, 0.085f, 0.022f);  // lawn
  vec3 high = vec3(0.135f, 0.165f, 0.052f);
  float contrast = 0.75f;
  float row_period = 0.0f;
  vec3 row_colour = vec3(0.0f);
  if (base == 1u) {  // meadow
    low = vec3(0.075f, 0.095f, 0.030f);
    high = vec3(0.215f, 0.205f, 0.085f);
    contrast = 0.95f;
  }
  if (base == 2u) {  // ploughed soil
    low = vec3(0.115f, 0.078f, 0.050f);
    high = vec3(0.205f, 0.150f, 0.100f);
    contrast = 0.7f;
    row_period = 0.62f;
    row_colour = vec3(0.075f, 0.052f, 0.035f);
  }
  if (base == 3u) {  // crop in rows
    low = vec3(0.062f, 0.110f, 0.028f);
    high = vec3(0.120f, 0.170f, 0.040f);
    contrast = 0.9f;
    row_period = 0.75f;
    row_colour = vec3(0.150f, 0.108f, 0.070f);
  }
  if (base == 4u) {  // forest floor
    low = vec3(0.050f, 0.042f, 0.024f);
    high = vec3(0.120f, 0.098f, 0.055f);
    contrast = 0.9f;
  }
  if (base == 5u) {  // gravel
    low = vec3(0.190f, 0.180f, 0.160f);
    high = vec3(0.300f, 0.285f, 0.255f);
    contrast = 0.8f;
  }
  if (base == 6u) {  // sand and scree
    low = vec3(0.240f, 0.172f, 0.112f);
    high = vec3(0.380f, 0.290f, 0.200f);
    contrast = 0.85f;
  }
  if (base == 7u) {  // water: dark, with faint still ripples
    low = vec3(0.016f, 0.034f, 0.040f);
    high = vec3(0.030f, 0.056f, 0.060f);
    contrast = 0.25f;
  }
  if (base == 8u) {  // asphalt yard
    low = vec3(0.090f, 0.090f, 0.094f);
    high = vec3(0.140f, 0.138f, 0.136f);
    contrast = 0.55f;
  }
  if (base == 9u) {  // ripe corn
    low = vec3(0.330f, 0.250f, 0.095f);
    high = vec3(0.470f, 0.370f, 0.150f);
    contrast = 0.5f;
    row_period = 0.28f;
    row_colour = vec3(0.230f, 0.165f, 0.060f);
  }
  vec3 colour = mix(low, high, clamp(0.5f + 0.8f * coarse + 0.35f * fine, 0.0f, 1.0f));
  for (int once = 0; once < (row_period > 0.0f ? 1 : 0); ++once) {
    float wander = 0.12f * valueNoise(p * 0.35f, 0x27d4eb2fu) + 0.06f * fine;
    float along = base == 3u ? 0.906f * p.x + 0.423f * p.y : 0.292f * p.x - 0.956f * p.y;
    colour = mix(colour, row_colour, 0.75f * stripes(along + wander, row_period, 0.38f, width));
  }
  colour = colour * (1.0f + contrast * (fine + 0.35f * coarse));

  // Planted beds, then paving (slabs), then the pavement beside the street, then the street.
  vec3 soil = mix(vec3(0.095f, 0.066f, 0.036f), vec3(0.060f, 0.110f, 0.030f), smoothstep(-0.1f, 0.35f, coarse + fine));
  colour = mix(colour, soil * (1.0f + 0.8f * fine), areaOf(here.bed + 0.15f * edge, soft));

  for (int once = 0; once < (here.paved > -soft ? 1 : 0); ++once) {
    float slab = unitOf(cellHash(int(floor(p.x / 0.6f)), int(floor(p.y / 0.6f)), 0x165667b1u));
    float joints = max(stripes(p.x, 0.6f, 0.05f, width), stripes(p.y, 0.6f, 0.05f, width));
    vec3 slabs = vec3(0.300f, 0.280f, 0.250f) * (0.86f + 0.28f * slab + 0.30f * fine + 0.25f * coarse) * (1.0f - 0.45f * joints);
    colour = mix(colour, slabs, areaOf(here.paved, soft));
  }

  float kerb = here.street + kerbWidth();
  for (int once = 0; once < (kerb > -soft ? 1 : 0); ++once) {
    vec3 walk = vec3(0.275f, 0.270f, 0.262f) * (0.9f + 0.35f * fine + 0.3f * coarse);
    walk = walk * (1.0f - 0.35f * (1.0f - smoothstep(0.0f, max(width, 0.05f), abs(here.street))));
    colour = mix(colour, walk, areaOf(kerb, soft));

    float patch_tone = step(0.28f, valueNoise(p * 0.21f, 0xd3a2646cu));  // repaired stretches
    float crack = 1.0f - smoothstep(0.010f, 0.022f + width, abs(valueNoise(p * 0.55f + vec2(fine, fine) * 0.25f, 0xfd7046c5u)));
    vec3 asphalt = mix(vec3(0.118f, 0.116f, 0.114f), vec3(0.078f, 0.078f, 0.081f), 0.75f * patch_tone);
    asphalt = asphalt * (1.0f + 0.55f * fine + 0.35f * coarse) * (1.0f - 0.45f * crack * keptOf(width, 0.1f));
    float line = areaOf(0.06f - abs(here.street - 0.30f), soft) * streetLines();
    asphalt = mix(asphalt, vec3(0.62f, 0.62f, 0.60f) * (0.85f + 0.4f * fine), line * step(-0.25f, fine));
    colour = mix(colour, asphalt, areaOf(here.street, soft));
  }
  return vec3(max(colour.x, 0.004f), max(colour.y, 0.004f), max(colour.z, 0.004f));
}

// --- made things -----------------------------------------------------------------------------------------

// A few tones of a palette, chosen by the object's own number.
vec3 toneOf(uint tint, vec3 a, vec3 b, vec3 c) {
  float pick = unitOf(mixBits(tint * 0x9e3779b1u + 77u));
  float between = unitOf(mixBits(tint * 0x85ebca77u + 13u));
  return pick < 0.5f ? mix(a, b, between) : mix(b, c, between);
}

// Linear albedo of a solid. uv are metres on the face: u along it, v up it (walls) or up the slope (roofs);
// tint numbers the object. Materials as in mesh.h.
vec3 solidAlbedo(uint material, uint tint, vec2 uv, float width) {
  vec2 shifted = uv + vec2(unitOf(mixBits(tint + 5u)), unitOf(mixBits(tint + 9u))) * 311.0f;
  float coarse = octaves(shifted, width, 6.0f, 0.6f, 0.78f, 0x9e3779b1u);
  float fine = 0.8f * octaves(shifted, width, 0.4f, 0.010f, 0.92f, 0x7f4a7c15u);
  vec3 colour = vec3(0.30f, 0.29f, 0.28f);  // concrete
  float contrast = 0.45f;
  float joints = 0.0f;
  float piece = 0.5f;
  if (material == 0u) {  // poured in bays
    joints = 0.5f * max(stripes(uv.x, 5.0f, 0.014f, width), stripes(uv.y, 5.0f, 0.014f, width));
  }
  if (material == 1u) {  // clay tiles: rows across the slope, each tile its own tone
    colour = toneOf(tint, vec3(0.330f, 0.110f, 0.058f), vec3(0.235f, 0.082f, 0.050f), vec3(0.160f, 0.085f, 0.062f));
    float row = floor(uv.y / 0.34f);
    float shift = 0.115f * step(0.5f, fract(row * 0.5f + 0.25f));
    piece = unitOf(cellHash(int(floor((uv.x + shift) / 0.23f)), int(row), tint));
    piece = mix(piece, 0.5f, clamp(2.0f * width / 0.23f - 0.6f, 0.0f, 1.0f));
    joints = 0.8f * stripes(uv.y, 0.34f, 0.16f, width) + 0.35f * stripes(uv.x + shift, 0.23f, 0.14f, width);
    contrast = 0.6f;
  }
  if (material == 2u) {  // slate
    colour = toneOf(tint, vec3(0.085f, 0.092f, 0.105f), vec3(0.125f, 0.125f, 0.130f), vec3(0.065f, 0.062f, 0.066f));
    float row = floor(uv.y / 0.22f);
    float shift = 0.15f * step(0.5f, fract(row * 0.5f + 0.25f));
    piece = unitOf(cellHash(int(floor((uv.x + shift) / 0.30f)), int(row), tint));
    piece = mix(piece, 0.5f, clamp(2.0f * width / 0.22f - 0.6f, 0.0f, 1.0f));
    joints = 0.6f * stripes(uv.y, 0.22f, 0.14f, width) + 0.3f * stripes(uv.x + shift, 0.30f, 0.07f, width);
    contrast = 0.55f;
  }
  if (material == 3u) {  // flat roof: bitumen sheets with gravel patches
    colour = toneOf(tint, vec3(0.155f, 0.152f, 0.150f), vec3(0.240f, 0.228f, 0.210f), vec3(0.330f, 0.322f, 0.310f));
    colour = colour * (1.0f - 0.5f * smoothstep(0.15f, 0.4f, coarse));
    joints = 0.5f * stripes(uv.x, 1.1f, 0.045f, width) + 0.3f * stripes(uv.y, 7.3f, 0.008f, width);
    contrast = 0.7f;
  }
  if (material == 4u) {  // plaster wall with windows
    colour = toneOf(tint, vec3(0.520f, 0.470f, 0.380f), vec3(0.600f, 0.590f, 0.560f), vec3(0.480f, 0.330f, 0.240f));
    float wx = abs(fract(uv.x / 2.6f) - 0.5f) * 2.6f;
    float wy = abs(fract(uv.y / 2.9f) - 0.55f) * 2.9f;
    float soft = max(0.5f * width, 0.01f);
    float frame = areaOf(0.62f - wx, soft) * areaOf(0.78f - wy, soft);
    float glass = areaOf(0.52f - wx, soft) * areaOf(0.68f - wy, soft) * (1.0f - 0.8f * areaOf(0.04f - wx, soft));
    float blind = unitOf(cellHash(int(floor(uv.x / 2.6f)), int(floor(uv.y / 2.9f)), tint));
    colour = mix(colour, vec3(0.66f, 0.65f, 0.62f), frame);
    colour = mix(colour, vec3(0.03f, 0.04f, 0.05f) + vec3(0.25f, 0.22f, 0.18f) * step(0.7f, blind), glass);
    contrast = 0.25f;
  }
  if (material == 5u) {  // container: corrugated sheet
    // One paint or another, never a mixture.
    float paint = unitOf(mixBits(tint * 0x9e3779b1u + 31u));
    colour = mix(vec3(0.300f, 0.060f, 0.040f), vec3(0.045f, 0.110f, 0.240f), step(0.3f, paint));
    colour = mix(colour, vec3(0.330f, 0.310f, 0.270f), step(0.55f, paint));
    colour = mix(colour, vec3(0.060f, 0.160f, 0.090f), step(0.75f, paint));
    colour = mix(colour, vec3(0.360f, 0.170f, 0.040f), step(0.88f, paint));
    colour = colour * (0.8f + 0.4f * unitOf(mixBits(tint * 0x85ebca77u + 7u)));
    joints = 0.55f * stripes(uv.x, 0.28f, 0.35f, width);
    contrast = 0.35f;
  }
  if (material == 6u) {  // rock face: strata
    colour = mix(vec3(0.400f, 0.235f, 0.140f), vec3(0.560f, 0.420f, 0.290f),
                 clamp(0.5f + 0.9f * valueNoise(vec2(uv.y * 0.31f + 0.5f * coarse, uv.x * 0.013f), 0xb5297a4du), 0.0f, 1.0f));
    joints = 0.5f * stripes(uv.y + 0.8f * coarse, 1.9f, 0.10f, width);
    contrast = 0.8f;
  }
  if (material == 7u) {  // hedge
    colour = mix(vec3(0.022f, 0.048f, 0.014f), vec3(0.085f, 0.135f, 0.040f), clamp(0.5f + 0.9f * fine, 0.0f, 1.0f));
    contrast = 0.9f;
  }
  if (material == 8u) {  // car paint and glass (v < 0 marks glass)
    colour = toneOf(tint, vec3(0.620f, 0.620f, 0.630f), vec3(0.060f, 0.062f, 0.070f), vec3(0.250f, 0.030f, 0.030f));
    colour = mix(colour, vec3(0.020f, 0.024f, 0.030f), step(uv.y, 0.0f));
    contrast = 0.1f;
  }
  if (material == 9u) {  // timber: decks, sheds, fences
    colour = toneOf(tint, vec3(0.230f, 0.150f, 0.090f), vec3(0.300f, 0.250f, 0.200f), vec3(0.150f, 0.105f, 0.075f));
    piece = unitOf(cellHash(int(floor(uv.x / 0.14f)), 3, tint));
    joints = 0.7f * stripes(uv.x, 0.14f, 0.10f, width);
    contrast = 0.45f;
  }
  if (material == 10u) {  // rocky plateau
    colour = mix(vec3(0.270f, 0.175f, 0.110f), vec3(0.420f, 0.310f, 0.210f), clamp(0.5f + 0.9f * coarse, 0.0f, 1.0f));
    colour = mix(colour, vec3(0.085f, 0.100f, 0.045f), 0.8f * smoothstep(0.18f, 0.3f, fine + 0.5f * coarse));
    contrast = 0.8f;
  }
  colour = colour * (1.0f + contrast * fine + 0.25f * coarse) * (0.78f + 0.44f * piece) * (1.0f - min(joints, 0.85f));
  return vec3(max(colour.x, 0.004f), max(colour.y, 0.004f), max(colour.z, 0.004f));
}
