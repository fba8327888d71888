// Pass 2, seed selection: a group a tile, an invocation a seed. Writes each seed's bin and its place among the
// tile's seeds of that bin, and the tile's count of every bin: order depends on nothing but the seeds.
layout(local_size_x = 128) in;
layout(std430, binding = 1) readonly buffer TileMap { uint tile_visible[]; };
layout(std430, binding = 2) writeonly buffer Slots { uint slots[]; };    // bin | rank << 8, or 255
layout(std430, binding = 3) writeonly buffer Counts { uint counts[]; };  // tile * kBins + bin
shared uint bins[128];
void main() {
  int t = int(gl_WorkGroupID.x);
  int index = int(gl_LocalInvocationID.x);
  uint bin = 255u;
  if (tile_visible[t] != 0u) {
    Plant plant = plantOf(tiles_from + ivec2(t % tiles_size.x, t / tiles_size.x), index);
    if (plant.species_seed.x != 0u) {
      vec3 centre = plant.foot_height.xyz + vec3(0.0, 0.0, 0.5 * plant.foot_height.w);
      float radius = length(vec2(1.6 * plant.radius_turn.x, 0.75 * plant.foot_height.w));
      float away = distance(centre, eye);
      if (inside(centre, radius) && away < rings.z) {
        bin = (plant.species_seed.x - 1u) * 3u + (away < rings.x ? 0u : away < rings.y ? 1u : 2u);
      }
    }
  }
  bins[index] = bin;
  barrier();
  uint rank = 0u;
  for (int i = 0; i < index; ++i) rank += bins[i] == bin ? 1u : 0u;
  slots[t * kSeeds + index] = bin | rank << 8;
  if (index < kBins) {
    uint count = 0u;
    for (int i = 0; i < kSeeds; ++i) count += bins[i] == uint(index) ? 1u : 0u;
    counts[t * kBins + index] = count;
  }
}
