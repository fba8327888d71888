// Filtered noise, compiled twice, as GLSL ES by the rasteriser and as C++ by the ray-tracer and the truth
// (glsl.h, appearance.cpp): it keeps to the common subset: no swizzles, literals with f and u, no
// out-parameters. The other shared files are material.glsl and foliage.glsl.
//
// Lengths are metres. `width` is the side of the pixel's footprint on the surface: detail finer than it is
// faded out.

uint mixBits(uint h) {
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  h ^= h >> 15;
  return h;
}

uint cellHash(int x, int y, uint seed) { return mixBits((uint(x) * 0x9e3779b1u) ^ (uint(y) * 0x85ebca77u) ^ seed); }

// Uniform in [0, 1), 24 bits.
float unitOf(uint h) { return float(h >> 8) * 5.9604644775390625e-8f; }

// Value noise, cells of side 1, in [-1, 1], C1. A frame asks for it a dozen times a pixel, so a corner's value
// is mixed by one multiplication, which is enough for its upper 24 bits: the lower ones are not read.
float cornerValue(uint h) {
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  return float(int(h >> 8));
}

float valueNoise(vec2 p, uint seed) {
  float fx = floor(p.x);
  float fy = floor(p.y);
  float tx = p.x - fx;
  float ty = p.y - fy;
  tx = tx * tx * (3.0f - 2.0f * tx);
  ty = ty * ty * (3.0f - 2.0f * ty);
  uint x0 = uint(int(fx)) * 0x9e3779b1u;
  uint x1 = x0 + 0x9e3779b1u;
  uint row = uint(int(fy)) * 0x85ebca77u;
  uint y0 = row ^ seed;
  uint y1 = (row + 0x85ebca77u) ^ seed;
  float a = mix(cornerValue(x0 ^ y0), cornerValue(x1 ^ y0), tx);
  float b = mix(cornerValue(x0 ^ y1), cornerValue(x1 ^ y1), tx);
  return mix(a, b, ty) * 1.1920928955078125e-7f - 1.0f;
}

// What a pixel of side `width` keeps of detail with cells of side `cell`.
float keptOf(float width, float cell) { return clamp(1.6f - 1.2f * width / cell, 0.0f, 1.0f); }

// Octaves from cells of `coarse` metres down to `fine`, halving; each octave turned against the last so that
// no axis shows. Amplitudes fall by `gain` an octave. Roughly in [-1, 1] for gain 0.7.
float octaves(vec2 p, float width, float coarse, float fine, float gain, uint seed) {
  float sum = 0.0f;
  float amplitude = 0.5f;
  float cell = coarse;
  vec2 q = p * (1.0f / coarse);
  uint s = seed;
  while (cell >= fine && cell > 0.75f * width) {
    sum += amplitude * keptOf(width, cell) * valueNoise(q, s);
    q = vec2(1.6f * q.x - 1.2f * q.y + 17.3f, 1.2f * q.x + 1.6f * q.y - 9.1f);  // turn by 36.9 deg, scale by 2
    cell *= 0.5f;
    amplitude *= gain;
    s += 0x6d2b79f5u;
  }
  return sum;
}

// 1 inside a stripe of `share` of the period, faded to its mean where the pixel is coarser than the stripe.
float stripes(float at, float period, float share, float width) {
  float t = abs(fract(at / period) - 0.5f) * 2.0f;  // 0 in the middle of the stripe
  float soft = max(width / period, 0.02f);
  float crisp = 1.0f - smoothstep(share - soft, share + soft, t);
  return mix(crisp, share, clamp(2.0f * width / period - 0.5f, 0.0f, 1.0f));
}
