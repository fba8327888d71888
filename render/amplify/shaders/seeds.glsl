// A seed's plant, as population.cpp makes it: place, land cover, rules, size. Shared by the passes below.
struct Plant {
  vec4 foot_height;  // east, north, up, height
  vec2 radius_turn;
  uvec2 species_seed;
};

layout(std430, binding = 0) readonly buffer Patterns { uint pattern_seeds[]; };  // x | y << 16, 1/65536 of a tile

uniform highp usampler2D cover;    // level 1 of the quadtree, one class a metre
uniform highp sampler2D heights;   // corners of the ground's grid
uniform vec2 cover_corner;         // west, south
uniform vec2 grid_corner;
uniform float grid_spacing;
uniform uint population_seed;
uniform ivec2 tiles_from;           // first tile
uniform ivec2 tiles_size;           // columns, rows
uniform vec4 rule_sizes[4];        // by species: least and greatest height, radius per height, steepest
uniform vec2 rule_limits[4];       // seeds of a pattern that take root, highest ground

const float kTile = 32.0;
const int kSeeds = 128;
const int kPatterns = 16;

uint mixBits(uint h) {
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  h ^= h >> 15;
  return h;
}
float unitOf(uint h) { return float(h >> 8) * 5.9604644775390625e-8; }

// Park and Miller's minimal standard generator, by Schrage's method: no product beyond 31 bits.
uint parkMiller(uint state) {
  int hi = int(state) / 127773;
  int lo = int(state) % 127773;
  int next = 16807 * lo - 2836 * hi;
  return uint(next > 0 ? next : next + 2147483647);
}

int patternOf(ivec2 tile) {
  uint place = uint(tile.x) * 0x9e3779b1u ^ uint(tile.y) * 0x85ebca77u ^ population_seed;
  uint state = place % 2147483646u + 1u;
  for (int i = 0; i < 3; ++i) state = parkMiller(state);
  return int((state >> 8) % uint(kPatterns));
}

float corner(ivec2 p) { return texelFetch(heights, p, 0).r; }

// The ground's triangles; a cell's diagonal runs from south-west to north-east.
float groundAt(vec2 p) {
  ivec2 size = textureSize(heights, 0);
  vec2 q = clamp((p - grid_corner) / grid_spacing, vec2(0.0), vec2(size - 1));
  ivec2 i = min(ivec2(q), size - 2);
  vec2 f = q - vec2(i);
  float sw = corner(i);
  float ne = corner(i + ivec2(1, 1));
  float other = corner(i + (f.x >= f.y ? ivec2(1, 0) : ivec2(0, 1)));
  return f.x >= f.y ? sw + f.x * (other - sw) + f.y * (ne - other) : sw + f.y * (other - sw) + f.x * (ne - other);
}

// Species 0 where the seed does not take root.
Plant plantOf(ivec2 tile, int index) {
  Plant plant;
  plant.species_seed = uvec2(0u);
  plant.radius_turn = vec2(0.0);
  uint packed_place = pattern_seeds[patternOf(tile) * kSeeds + index];
  vec2 at = (vec2(tile) + vec2(packed_place & 65535u, packed_place >> 16) * (1.0 / 65536.0)) * kTile;
  plant.foot_height = vec4(at, 0.0, 0.0);
  ivec2 texel = ivec2(floor(at - cover_corner));
  if (any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, textureSize(cover, 0)))) return plant;
  uint species = texelFetch(cover, texel, 0).r;
  vec4 size = rule_sizes[species];
  if (species == 0u || index >= int(rule_limits[species].x)) return plant;
  float up = groundAt(at);
  vec2 d = vec2(grid_spacing, 0.0);
  vec2 slope = vec2(groundAt(at + d.xy) - groundAt(at - d.xy), groundAt(at + d.yx) - groundAt(at - d.yx)) / (2.0 * grid_spacing);
  if (length(slope) > size.w || up > rule_limits[species].y) return plant;
  uint seed = mixBits((uint(tile.x) * 0x9e3779b1u) ^ (uint(tile.y) * 0x85ebca77u) ^ (uint(index) * 0xc2b2ae3du) ^ population_seed);
  float height = size.x + (size.y - size.x) * unitOf(mixBits(seed + 1u));
  plant.foot_height.zw = vec2(up, height);
  plant.radius_turn = vec2(height * size.z * (0.8 + 0.4 * unitOf(mixBits(seed + 2u))), 6.2831853 * unitOf(mixBits(seed + 3u)));
  plant.species_seed = uvec2(species, seed);
  return plant;
}

// The view: a sphere is kept when it is not wholly outside one plane (inward normals, scene ENU).
uniform vec4 planes[6];
uniform vec3 eye;
uniform vec3 rings;  // distances up to which LOD 0, 1 and 2 are drawn, metres

bool inside(vec3 centre, float radius) {
  for (int i = 0; i < 6; ++i) {
    if (dot(planes[i].xyz, centre) + planes[i].w < -radius) return false;
  }
  return true;
}

const int kBins = 9;  // (species - 1) * 3 + LOD
