// Sums over one block of BLOCK x BLOCK pixels, every second pixel of every second row: count of valid ones,
// luminance, its square, and the square of its Laplacian. One invocation a block: no shared memory, which
// software rasterisers pay dearly.
layout(local_size_x = 8, local_size_y = 8) in;
layout(std430, binding = 0) writeonly buffer Sums { vec4 sums[]; };
uniform sampler2D color;
uniform sampler2D luma;
uniform ivec2 blocks;
void main() {
  ivec2 block = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(block, blocks))) return;
  ivec2 size = textureSize(luma, 0);
  ivec2 end = min((block + 1) * BLOCK, size - 1);
  vec4 sum = vec4(0.0);
  for (int y = max(block.y * BLOCK, 1); y < end.y; y += 2) {
    for (int x = max(block.x * BLOCK, 1); x < end.x; x += 2) {
      ivec2 p = ivec2(x, y);
      if (texelFetch(color, p, 0).a < 0.5) continue;
      float v = texelFetch(luma, p, 0).r;
      float laplacian = texelFetch(luma, p + ivec2(1, 0), 0).r + texelFetch(luma, p - ivec2(1, 0), 0).r +
                        texelFetch(luma, p + ivec2(0, 1), 0).r + texelFetch(luma, p - ivec2(0, 1), 0).r - 4.0 * v;
      sum += vec4(1.0, v, v * v, laplacian * laplacian);
    }
  }
  sums[block.y * blocks.x + block.x] = sum;
}
