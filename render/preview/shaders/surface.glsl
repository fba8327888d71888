// The surface over one cell: SURFACE 0 blocks, 1 linear, 2 Hermite patches (thesis, (4.9)-(4.14)), blended with
// the next coarser level's by tau (4.8). Heights of the cell and its neighbours: h[3 * row + column], rows
// southwards; h[4] is the cell.

// A tile in GPU memory always has its parent there, too.
ivec3 parentPlace(int level, ivec2 cell) {
  ivec2 parent = cell >> 1;
  return heightPlace(level + 1, parent, slotOfCell(level + 1, parent));
}

void neighbourhood(ivec3 place, out float h[9]) {
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) h[3 * j + i] = heightAt(place, ivec2(i - 1, j - 1));
}

#if SURFACE == 1
// Of the bilinear surface at the cell's corners, edge middles and centre: g[3 * row + column].
void halfPoints(float h[9], out float g[9]) {
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      // Column 0 lies between columns 0 and 1 of h, column 1 on 1, column 2 between 1 and 2.
      int a = i == 0 ? 0 : 1, b = i == 2 ? 2 : 1;
      int c = j == 0 ? 0 : 1, d = j == 2 ? 2 : 1;
      g[3 * j + i] = 0.25 * (h[3 * c + a] + h[3 * c + b] + h[3 * d + a] + h[3 * d + b]);
    }
  }
}
#endif

#if SURFACE == 2
// h(s, t) = b(s) G b(t), (4.10).
mat4 hermiteGeometry(float h[9]) {
  float value[4], along_u[4], along_v[4], mixed[4];  // corner 2 * (v end) + (u end)
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < 2; ++i) {
      float nw = h[3 * j + i], ne = h[3 * j + i + 1], sw = h[3 * j + i + 3], se = h[3 * j + i + 4];
      int k = 2 * j + i;
      value[k] = min(min(nw, ne), min(sw, se));
      along_u[k] = 0.5 * (ne + se - nw - sw);
      along_v[k] = 0.5 * (sw + se - nw - ne);
      mixed[k] = se - sw - ne + nw;
    }
  }
  // Columns follow t: value at its ends, slope at its ends.
  return mat4(value[0], value[1], along_u[0], along_u[1], value[2], value[3], along_u[2], along_u[3],
              along_v[0], along_v[1], mixed[0], mixed[1], along_v[2], along_v[3], mixed[2], mixed[3]);
}
vec4 hermite(float s) {
  float s2 = s * s, s3 = s2 * s;
  return vec4(2.0 * s3 - 3.0 * s2 + 1.0, 3.0 * s2 - 2.0 * s3, s3 - 2.0 * s2 + s, s3 - s2);
}
float patchHeight(mat4 g, vec2 u) { return dot(hermite(u.x), g * hermite(u.y)); }
#endif

// Slope of a smooth surface through the heights (quadratic B-spline), per cell width: for shading, continuous
// across cells.
vec2 smoothSlope(float h[9], vec2 u) {
  vec3 bu = vec3(0.5 * (1.0 - u.x) * (1.0 - u.x), 0.5 + u.x * (1.0 - u.x), 0.5 * u.x * u.x);
  vec3 bv = vec3(0.5 * (1.0 - u.y) * (1.0 - u.y), 0.5 + u.y * (1.0 - u.y), 0.5 * u.y * u.y);
  vec3 west_to_east = vec3(0.0), north_to_south = vec3(0.0);
  for (int k = 0; k < 3; ++k) {
    west_to_east[k] = mix(h[3 * k + 1] - h[3 * k], h[3 * k + 2] - h[3 * k + 1], u.x);
    north_to_south[k] = mix(h[3 + k] - h[k], h[6 + k] - h[3 + k], u.y);
  }
  return vec2(dot(west_to_east, bv), dot(north_to_south, bu));
}

// Where the ray's part over a cell first is on or below the surface: from local position u0 (in [0, 1]^2) and
// height z0 to u1 and z1. Returns the share of the way, or -1. (4.2)
float meetSurface(int level, ivec2 cell, int slot, float tau, vec2 u0, vec2 u1, float z0, float z1) {
#if SURFACE == 0
  float height = heightAt(heightPlace(level, cell, slot), ivec2(0));
  if (tau > 0.0) height = mix(height, heightAt(parentPlace(level, cell), ivec2(0)), tau);
  if (z0 <= height) return 0.0;
  return z1 <= height ? (z0 - height) / (z0 - z1) : -1.0;
#else
  float h[9];
  neighbourhood(heightPlace(level, cell, slot), h);
#if SURFACE == 1
  float g[9];
  halfPoints(h, g);
  if (tau > 0.0) {
    // One bilinear patch of the coarser level lies over the whole cell.
    ivec2 child = cell & 1;
    ivec3 parent = parentPlace(level, cell);
    float a = heightAt(parent, child - 1), b = heightAt(parent, ivec2(child.x, child.y - 1));
    float c = heightAt(parent, ivec2(child.x - 1, child.y)), d = heightAt(parent, child);
    vec2 from = 0.5 * vec2(1 - child);
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) {
        vec2 f = from + 0.25 * vec2(i, j);
        g[3 * j + i] = mix(g[3 * j + i], mix(mix(a, b, f.x), mix(c, d, f.x), f.y), tau);
      }
    }
  }
  vec2 d = u1 - u0;
  float dz = z1 - z0;
  // Up to three of the four quadrants, between each of which the surface has a kink.
  float first = 1.0, second = 1.0;
  if ((u0.x - 0.5) * (u1.x - 0.5) < 0.0) first = (0.5 - u0.x) / d.x;
  if ((u0.y - 0.5) * (u1.y - 0.5) < 0.0) second = (0.5 - u0.y) / d.y;
  float cuts[4];
  cuts[0] = 0.0;
  cuts[1] = min(first, second);
  cuts[2] = max(first, second);
  cuts[3] = 1.0;
  for (int i = 0; i < 3; ++i) {
    float s0 = cuts[i], s1 = cuts[i + 1];
    if (i > 0 && s1 <= s0) continue;
    vec2 middle = u0 + (0.5 * (s0 + s1)) * d;
    ivec2 q = ivec2(greaterThanEqual(middle, vec2(0.5)));
    float north_west = g[3 * q.y + q.x], north_east = g[3 * q.y + q.x + 1];
    float south_west = g[3 * q.y + q.x + 3], south_east = g[3 * q.y + q.x + 4];
    vec2 at = 2.0 * (u0 + s0 * d) - vec2(q);  // in the quadrant's own [0, 1]^2
    vec2 step_ = 2.0 * d;
    float east = north_east - north_west, south = south_west - north_west;
    float twist = south_east - south_west - east;
    // Height of the ray over the surface: c + b s + a s^2.
    float c = z0 + s0 * dz - (north_west + east * at.x + south * at.y + twist * at.x * at.y);
    if (c <= 0.0) return s0;
    float b = dz - (east * step_.x + south * step_.y + twist * (at.x * step_.y + at.y * step_.x));
    float a = -twist * step_.x * step_.y;
    float root = b * b - 4.0 * a * c;
    if (root < 0.0) continue;
    float below = sqrt(root) - b;  // the smallest positive root, without cancellation
    if (below <= 0.0) continue;
    float s = 2.0 * c / below;
    if (s <= s1 - s0) return s0 + s;
  }
  return -1.0;
#else
  mat4 g = hermiteGeometry(h), coarse = mat4(0.0);
  vec2 corner = 0.5 * vec2(cell & 1);
  if (tau > 0.0) {
    float k[9];
    neighbourhood(parentPlace(level, cell), k);
    coarse = hermiteGeometry(k);
  }
  // 16 steps, as the thesis found enough, and then halves of the one where the ray dives.
  float before = 0.0, after = -1.0;
  for (int i = 0; i <= 16; ++i) {
    float s = float(i) / 16.0;
    vec2 u = mix(u0, u1, s);
    float height = patchHeight(g, u);
    if (tau > 0.0) height = mix(height, patchHeight(coarse, corner + 0.5 * u), tau);
    if (mix(z0, z1, s) <= height) {
      after = s;
      break;
    }
    before = s;
  }
  if (after <= 0.0) return after;
  for (int k = 0; k < 16; ++k) {
    float m = 0.5 * (before + after);
    vec2 u = mix(u0, u1, m);
    float height = patchHeight(g, u);
    if (tau > 0.0) height = mix(height, patchHeight(coarse, corner + 0.5 * u), tau);
    if (mix(z0, z1, m) > height) before = m; else after = m;
  }
  return after;
#endif
#endif
}
