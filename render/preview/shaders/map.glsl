// The map in GPU memory: tiles of levels 0 .. top_level-1, and in two more slots level top_level and the levels
// above it, in atlases of ATLAS x ATLAS tiles a layer, found through a table of each level's active area.
// A cell is a texel of a level, counted from the domain's north-west corner.
uniform highp sampler2DArray height_tiles;  // with a rim of one texel
uniform highp sampler2DArray bound_tiles;
uniform highp sampler2DArray color_tiles;   // with a rim
uniform highp sampler2DArray quality_tiles;
uniform highp usampler2D slots;  // r: slot + 1, or 0; g: age

uniform int top_level;           // L - 1
uniform int last_level;          // the level of one texel
uniform int table_stride;
uniform vec4 window[MAX_LEVELS];   // active area of each level: first tile, tiles across (whole numbers)
uniform ivec2 origin_cell;         // the level-0 cell that positions count from

const int TILE = 1 << TILE_LOG2;
const float NO_HEIGHT = -1e29;  // everything below is none

// 2^e, exactly.
float power2(int e) { return uintBitsToFloat(uint(127 + e) << 23); }
ivec2 originAt(int level) { return origin_cell >> level; }
vec2 originFraction(int level) {
  return vec2(origin_cell & ((1 << level) - 1)) * power2(-level);
}
// Position (level-0 texels from origin_cell) in texels of a level, from that level's cell at the origin.
vec2 atLevel(vec2 position, int level) { return position * power2(-level) + originFraction(level); }
int across(int level) { return 1 << (last_level - level); }

// -1: this tile is not in GPU memory.
int slotOf(int level, ivec2 tile) {
  ivec4 w = ivec4(window[level]);
  ivec2 i = tile - w.xy;
  if (any(lessThan(i, ivec2(0))) || any(greaterThanEqual(i, w.zw))) return -1;
  return int(texelFetch(slots, ivec2(i.x, level * table_stride + i.y), 0).r) - 1;
}
int slotOfCell(int level, ivec2 cell) { return slotOf(level, cell >> TILE_LOG2); }

// Where a level begins within its slot, `rim` texels around each level: those above top_level share one, the
// first at its corner and the others in a column beside it.
ivec2 levelPlace(int level, int rim) {
  int k = level - top_level;
  if (k < 2) return ivec2(0);
  return ivec2((TILE >> 1) + 2 * rim, (TILE >> 1) - (TILE >> (k - 1)) + 2 * rim * (k - 2));
}
ivec3 inAtlas(int level, ivec2 cell, int slot, int rim) {
  int in_layer = slot % (ATLAS * ATLAS);
  return ivec3(ivec2(in_layer % ATLAS, in_layer / ATLAS) * (TILE + 2 * rim) + levelPlace(level, rim) + rim +
               (cell & (TILE - 1)), slot / (ATLAS * ATLAS));
}

float boundAt(int level, ivec2 cell, int slot) {
  return texelFetch(bound_tiles, inAtlas(level, cell, slot, 0), 0).r;
}
// Texel of height_tiles; its eight neighbours lie around it.
ivec3 heightPlace(int level, ivec2 cell, int slot) { return inAtlas(level, cell, slot, 1); }
float heightAt(ivec3 place, ivec2 offset) { return texelFetch(height_tiles, place + ivec3(offset, 0), 0).r; }
vec2 qualityAt(int level, ivec2 cell, int slot) {
  return texelFetch(quality_tiles, inAtlas(level, cell, slot, 0), 0).rg;
}
