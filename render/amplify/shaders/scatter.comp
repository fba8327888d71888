// Pass 4: writes the chosen plants, packed, as instances of their bin.
layout(local_size_x = 128) in;
layout(std430, binding = 2) readonly buffer Slots { uint slots[]; };
layout(std430, binding = 3) readonly buffer Counts { uint counts[]; };
layout(std430, binding = 5) writeonly buffer Instances { Plant instances[]; };
uniform int capacity;  // instances of a bin
void main() {
  int t = int(gl_WorkGroupID.x);
  int index = int(gl_LocalInvocationID.x);
  uint slot = slots[t * kSeeds + index];
  uint bin = slot & 255u;
  if (bin == 255u) return;
  uint place = counts[t * kBins + int(bin)] + (slot >> 8);
  if (place >= uint(capacity)) return;
  instances[int(bin) * capacity + int(place)] = plantOf(tiles_from + ivec2(t % tiles_size.x, t / tiles_size.x), index);
}
