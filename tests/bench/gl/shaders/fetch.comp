layout(local_size_x = LOCAL_X, local_size_y = LOCAL_Y) in;
layout(rgba16f, binding = 0) writeonly uniform highp image2D target;
void main() {
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  VALUE sum = walk(texel);
  imageStore(target, texel, vec4(sum * (1.0 / float(READS))));
}
