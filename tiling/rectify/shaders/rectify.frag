// One pinhole pixel: where it lies in the source image, the bilinear colour there, its luminance.
// SOURCE says how the source image is stored.
#define SOURCE_GREY 0
#define SOURCE_RGB 1
#define SOURCE_BGR 2
#define SOURCE_NV12 3  // full-range BT.601; chroma samples in the middle of their 2 x 2 pixels

layout(location = 0) out vec4 color;  // alpha 1: valid, 0: outside the source image
layout(location = 1) out float luma;

uniform sampler2D shift_grid;  // source pixel minus pinhole pixel at the nodes
uniform float grid_step;       // pinhole pixels between nodes
uniform ivec2 source_size;
uniform sampler2D plane0;
#if SOURCE == SOURCE_NV12
uniform sampler2D plane1;
#endif

// The weights are our own: the sampler's have 8 bits at best.
vec4 bilinear(sampler2D image, vec2 pixel, ivec2 size) {
  vec2 at = pixel - 0.5;
  vec2 low = floor(at);
  vec2 f = at - low;
  ivec2 i = ivec2(low);
  ivec2 a = clamp(i, ivec2(0), size - 1);
  ivec2 b = clamp(i + 1, ivec2(0), size - 1);
  return mix(mix(texelFetch(image, a, 0), texelFetch(image, ivec2(b.x, a.y), 0), f.x),
             mix(texelFetch(image, ivec2(a.x, b.y), 0), texelFetch(image, b, 0), f.x), f.y);
}

vec3 colorAt(vec2 pixel) {
#if SOURCE == SOURCE_GREY
  return bilinear(plane0, pixel, source_size).rrr;
#elif SOURCE == SOURCE_RGB
  return bilinear(plane0, pixel, source_size).rgb;
#elif SOURCE == SOURCE_BGR
  return bilinear(plane0, pixel, source_size).bgr;
#else
  float y = bilinear(plane0, pixel, source_size).r;
  vec2 c = bilinear(plane1, pixel * 0.5, (source_size + 1) / 2).rg - 128.0 / 255.0;
  return clamp(vec3(y + 1.402 * c.y, y - 0.344136 * c.x - 0.714136 * c.y, y + 1.772 * c.x), 0.0, 1.0);
#endif
}

void main() {
  vec2 pixel = gl_FragCoord.xy;
  vec2 node = pixel / grid_step;
  ivec2 n = ivec2(floor(node));
  vec2 f = node - vec2(n);
  vec2 s00 = texelFetch(shift_grid, n, 0).rg, s10 = texelFetch(shift_grid, n + ivec2(1, 0), 0).rg;
  vec2 s01 = texelFetch(shift_grid, n + ivec2(0, 1), 0).rg, s11 = texelFetch(shift_grid, n + ivec2(1, 1), 0).rg;
  vec2 source = pixel + mix(mix(s00, s10, f.x), mix(s01, s11, f.x), f.y);
  // Outside, the nearest border pixel goes on, so that mip levels carry no dark rim; alpha tells.
  const float kSlack = 1e-3;  // pixels: rounding of the sum above
  bool valid = all(greaterThanEqual(source, vec2(0.5 - kSlack))) &&
               all(lessThanEqual(source, vec2(source_size) - 0.5 + kSlack));
  vec3 rgb = colorAt(clamp(source, vec2(0.5), vec2(source_size) - 0.5));
  color = vec4(rgb, valid ? 1.0 : 0.0);
  luma = dot(rgb, vec3(0.212671, 0.715160, 0.072169));  // (5.10)
}
