// Pass 1, the tile load map: which tiles may hold visible plants. One invocation a tile.
layout(local_size_x = 64) in;
layout(std430, binding = 1) writeonly buffer TileMap { uint tile_visible[]; };
uniform vec2 ground_range;    // lowest and highest ground, metres
uniform float tallest;        // plant, metres
void main() {
  int t = int(gl_GlobalInvocationID.x);
  if (t >= tiles_size.x * tiles_size.y) return;
  vec2 corner_at = vec2(tiles_from + ivec2(t % tiles_size.x, t / tiles_size.x)) * kTile;
  vec3 low = vec3(corner_at, ground_range.x);
  vec3 high = vec3(corner_at + kTile, ground_range.y + tallest);
  vec3 middle = 0.5 * (low + high);
  float reach = 0.5 * length(high - low) + tallest;
  tile_visible[t] = inside(middle, reach) && distance(middle, eye) - reach < rings.z ? 1u : 0u;
}
