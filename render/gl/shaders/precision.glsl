// Mantissa bits of highp float as computed, 23 for IEEE single. `one` is a uniform so that no compiler knows
// the answer.
uniform float one;
float mantissaBits() {
  float step_size = one;
  int bits = 0;
  for (int i = 0; i < 64; ++i) {
    step_size *= 0.5;
    // Compared as bits: Mesa simplifies one + x == one to x == 0.
    if (floatBitsToUint(one + step_size) == floatBitsToUint(one)) break;
    ++bits;
  }
  return float(bits);
}
