// The footprint of a pixel in a surface's own metres, cut into taps along its longer side.
struct Footprint {
  vec2 longer;
  float width;
  int taps;
};
Footprint footprintOf(vec2 dx, vec2 dy) {
  float a = dot(dx, dx);
  float b = dot(dy, dy);
  Footprint f;
  f.longer = a >= b ? dx : dy;
  float long_side = sqrt(max(a, b));
  float short_side = sqrt(min(a, b));
  f.taps = clamp(int(long_side / max(short_side, 1e-9) + 0.25), 1, 4);
  f.width = max(long_side / float(f.taps), short_side);
  return f;
}
