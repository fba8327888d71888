// 7 x 7 box mean of a LOCAL_X x LOCAL_Y block, separable in shared memory with two barriers.
layout(local_size_x = LOCAL_X, local_size_y = LOCAL_Y) in;
uniform sampler2D source;
layout(r32f, binding = 0) writeonly uniform highp image2D target;
const int kRadius = 3;
const int kWidth = LOCAL_X + 2 * kRadius;
const int kHeight = LOCAL_Y + 2 * kRadius;
shared float tile[kWidth * kHeight];
shared float rows[LOCAL_X * kHeight];
void main() {
  ivec2 origin = ivec2(gl_WorkGroupID.xy) * ivec2(LOCAL_X, LOCAL_Y) - kRadius;
  int me = int(gl_LocalInvocationIndex);
  for (int i = me; i < kWidth * kHeight; i += LOCAL_X * LOCAL_Y) {
    tile[i] = texelFetch(source, max(origin + ivec2(i % kWidth, i / kWidth), ivec2(0)), 0).r;
  }
  barrier();
  for (int i = me; i < LOCAL_X * kHeight; i += LOCAL_X * LOCAL_Y) {
    int at = (i / LOCAL_X) * kWidth + i % LOCAL_X;
    float sum = 0.0;
    for (int k = 0; k <= 2 * kRadius; ++k) sum += tile[at + k];
    rows[i] = sum;
  }
  barrier();
  float sum = 0.0;
  for (int k = 0; k <= 2 * kRadius; ++k) sum += rows[me + k * LOCAL_X];
  imageStore(target, ivec2(gl_GlobalInvocationID.xy), vec4(sum * (1.0 / 49.0)));
}
