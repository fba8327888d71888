// Pass 3, stream compaction: each bin's counts become the places where the tiles' plants begin.
layout(local_size_x = 9) in;
layout(std430, binding = 3) buffer Counts { uint counts[]; };
layout(std430, binding = 4) writeonly buffer Totals { uint totals[]; };
void main() {
  int bin = int(gl_LocalInvocationID.x);
  uint sum = 0u;
  for (int t = 0; t < tiles_size.x * tiles_size.y; ++t) {
    uint count = counts[t * kBins + bin];
    counts[t * kBins + bin] = sum;
    sum += count;
  }
  totals[bin] = sum;
}
