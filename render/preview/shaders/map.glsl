// The map in GPU memory: tiles of levels 0 .. top_level-1 in atlases of ATLAS x ATLAS tiles a layer, found
// through a table of each level's active area; level top_level and above as one texture with mip levels.
// A cell is a texel of a level, counted from the domain's north-west corner.
uniform highp sampler2DArray height_tiles;  // with a rim of one texel
uniform highp sampler2DArray bound_tiles;
uniform highp sampler2DArray color_tiles;   // with a rim
uniform highp sampler2DArray quality_tiles;
uniform highp sampler2D top_heights;
uniform highp sampler2D top_bounds;
uniform highp sampler2D top_color;
uniform highp sampler2D top_quality;
uniform highp usampler2D slots;  // r: slot + 1, or 0; g: age

uniform int top_level;           // L - 1
uniform int last_level;          // the level of one texel
uniform int table_stride;
uniform vec4 window[MAX_LEVELS];   // active area of each level: first tile, tiles across (whole numbers)
uniform ivec2 origin_cell;         // the level-0 cell that positions count from

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

// -1: this tile is not in GPU memory. level < top_level.
int slotOf(int level, ivec2 tile) {
  ivec4 w = ivec4(window[level]);
  ivec2 i = tile - w.xy;
  if (any(lessThan(i, ivec2(0))) || any(greaterThanEqual(i, w.zw))) return -1;
  return int(texelFetch(slots, ivec2(i.x, level * table_stride + i.y), 0).r) - 1;
}
int slotOfCell(int level, ivec2 cell) { return slotOf(level, cell >> TILE_LOG2); }

ivec3 inAtlas(int slot, ivec2 texel, int stride) {
  int in_layer = slot % (ATLAS * ATLAS);
  return ivec3(ivec2(in_layer % ATLAS, in_layer / ATLAS) * stride + texel, slot / (ATLAS * ATLAS));
}
ivec2 inTile(ivec2 cell) { return cell & ((1 << TILE_LOG2) - 1); }

float boundAt(int level, ivec2 cell, int slot) {
  if (level >= top_level) return texelFetch(top_bounds, cell, level - top_level).r;
  return texelFetch(bound_tiles, inAtlas(slot, inTile(cell), 1 << TILE_LOG2), 0).r;
}
// Of the cell at `offset` (-1 .. 1) from `cell`.
float heightAt(int level, ivec2 cell, int slot, ivec2 offset) {
  if (level < top_level)
    return texelFetch(height_tiles, inAtlas(slot, inTile(cell) + 1 + offset, (1 << TILE_LOG2) + 2), 0).r;
  float h = texelFetch(top_heights, clamp(cell + offset, ivec2(0), ivec2(across(level) - 1)), level - top_level).r;
  return h < NO_HEIGHT ? texelFetch(top_heights, cell, level - top_level).r : h;
}
vec2 qualityAt(int level, ivec2 cell, int slot) {
  if (level >= top_level) return texelFetch(top_quality, cell, level - top_level).rg;
  return texelFetch(quality_tiles, inAtlas(slot, inTile(cell), 1 << TILE_LOG2), 0).rg;
}
