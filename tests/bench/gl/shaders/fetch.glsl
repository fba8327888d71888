// One bilinear read at pixel coordinates (first texel's centre at 0.5), by METHOD.
#define METHOD_SAMPLE 0   // textureLod
#define METHOD_GATHER 1   // textureGather of one channel and own weights
#define METHOD_TEXEL 2    // four texelFetch and own weights
#define METHOD_STORAGE 3  // four bytes out of a storage buffer of uints and own weights
#define METHOD_NEAREST 4  // one texelFetch, for comparison
#define METHOD_LEVEL 5    // textureLod of level 1
#define METHOD_QUAD 6     // one texelFetch of RGBA8 whose channels are the 2 x 2 neighbourhood, own weights
#define METHOD_QUAD_WORD 7     // the same out of an R32UI texture
#define METHOD_QUAD_STORAGE 8  // the same out of a storage buffer of uints

uniform vec2 inverse_size;
#if METHOD == METHOD_QUAD_STORAGE
layout(std430, binding = 1) readonly buffer Source { uint source_words[]; };
uniform int row_words;
#elif METHOD == METHOD_QUAD_WORD
uniform highp usampler2D source;
#elif METHOD == METHOD_STORAGE
layout(std430, binding = 1) readonly buffer Source { uint source_words[]; };
uniform int row_words;
float byteAt(ivec2 p) {
  uint word = source_words[p.y * row_words + (p.x >> 2)];
  return float((word >> uint((p.x & 3) * 8)) & 255u) * (1.0 / 255.0);
}
#elif defined(LAYERED)
uniform sampler2DArray source;
#else
uniform sampler2D source;
#endif

#if METHOD == METHOD_SAMPLE
VALUE fetchAt(vec2 p) {
#ifdef LAYERED
  return VALUE(textureLod(source, vec3(p * inverse_size, 1.0), 0.0));
#else
  return VALUE(textureLod(source, p * inverse_size, 0.0));
#endif
}
#elif METHOD == METHOD_LEVEL
VALUE fetchAt(vec2 p) { return VALUE(textureLod(source, p * inverse_size, 1.0)); }
#elif METHOD == METHOD_NEAREST
VALUE fetchAt(vec2 p) { return VALUE(texelFetch(source, ivec2(p), 0)); }
#elif METHOD == METHOD_GATHER
float fetchAt(vec2 p) {
  vec4 four = textureGather(source, p * inverse_size, 0);
  vec2 f = fract(p - 0.5);
  return mix(mix(four.w, four.z, f.x), mix(four.x, four.y, f.x), f.y);
}
#elif METHOD == METHOD_TEXEL
VALUE fetchAt(vec2 p) {
  vec2 q = p - 0.5;
  ivec2 i = ivec2(floor(q));
  vec2 f = q - vec2(i);
  VALUE a = VALUE(texelFetch(source, i, 0)), b = VALUE(texelFetch(source, i + ivec2(1, 0), 0));
  VALUE c = VALUE(texelFetch(source, i + ivec2(0, 1), 0)), d = VALUE(texelFetch(source, i + ivec2(1, 1), 0));
  return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}
#elif METHOD == METHOD_STORAGE
float fetchAt(vec2 p) {
  vec2 q = p - 0.5;
  ivec2 i = ivec2(floor(q));
  vec2 f = q - vec2(i);
  return mix(mix(byteAt(i), byteAt(i + ivec2(1, 0)), f.x),
             mix(byteAt(i + ivec2(0, 1)), byteAt(i + ivec2(1, 1)), f.x), f.y);
}
#endif
#if METHOD == METHOD_QUAD || METHOD == METHOD_QUAD_WORD || METHOD == METHOD_QUAD_STORAGE
float fetchAt(vec2 p) {
  vec2 q = p - 0.5;
  ivec2 i = ivec2(floor(q));
  vec2 f = q - vec2(i);
#if METHOD == METHOD_QUAD
  vec4 four = texelFetch(source, i, 0);
#elif METHOD == METHOD_QUAD_WORD
  vec4 four = unpackUnorm4x8(texelFetch(source, i, 0).r);
#else
  vec4 four = unpackUnorm4x8(source_words[i.y * row_words + i.x]);
#endif
  return mix(mix(four.x, four.y, f.x), mix(four.z, four.w, f.x), f.y);
}
#endif

// READS reads along a straight line, as a plane sweep reads along the epipolar line; the sum keeps them alive.
uniform vec2 along;
VALUE walk(ivec2 texel) {
  vec2 p = vec2(texel) * 0.97 + 40.3;
  VALUE sum = VALUE(0.0);
  for (int i = 0; i < READS; i += 4) {
    sum += fetchAt(p);
    sum += fetchAt(p + along);
    sum += fetchAt(p + 2.0 * along);
    sum += fetchAt(p + 3.0 * along);
    p += 4.0 * along;
  }
  return sum;
}
