// Rays through the maximum pyramid, cell by cell, down and up (thesis, 4.2.2 and 4.2.3).
uniform float lowest, highest;  // of all surfaces, with a margin
uniform float chord_metres, chord_growth;
uniform int max_steps;

struct Ray {
  vec3 start, along, bend;  // position = start + t along + t^2 bend; texels, texels, metres
};
vec3 pointOf(Ray ray, float t) { return ray.start + t * (ray.along + t * ray.bend); }

struct Hit {
  bool found;
  float t;         // metres from the ray's start
  vec3 position;   // texels from origin_cell, height
  int level;
  ivec2 cell;      // of that level
  int slot;
  float tau;       // share of the next coarser level
  vec2 local;      // within the cell
  int entered;     // how the ray came into the cell: 0 otherwise, 1 across a west or east border, 2 north or south
  bool at_entry;   // on the border itself: a wall
  int steps;
};

// The distance beyond which a + b t + c t^2 = x is passed towards x, for |c t| << |b|.
float crossing(float a, float b, float c, float x) {
  float t = (x - a) / b;
  for (int i = 0; i < 3; ++i) t -= (a + t * (b + t * c) - x) / (b + 2.0 * t * c);
  return t;
}

// First distance at which the ray is inside the domain's box; negative: never.
float enterDomain(Ray ray) {
  float t = 0.0;
  if (ray.start.z > highest) {
    // The height is convex in t: the ground falls away.
    float a = ray.bend.z, b = ray.along.z, c = ray.start.z - highest;
    float root = b * b - 4.0 * a * c;
    if (b >= 0.0 || root < 0.0) return -1.0;
    t = 2.0 * c / (sqrt(root) - b);
  }
  float size = float(across(0));
  for (int k = 0; k < 2; ++k) {
    float west = float(-origin_cell[k]), east = west + size;
    float at = ray.start[k] + t * (ray.along[k] + t * ray.bend[k]);
    if (at >= west && at <= east) continue;
    float to = at < west ? west : east;
    if (ray.along[k] == 0.0 || (to - at) * ray.along[k] < 0.0) return -1.0;
    t = max(t, crossing(ray.start[k], ray.along[k], ray.bend[k], to));
  }
  // Past a corner: by the time that one side is entered another has been left.
  vec2 p = pointOf(ray, t).xy, slack = 0.02 + 1e-6 * abs(p);
  if (any(lessThan(p, vec2(-origin_cell) - slack)) || any(greaterThan(p, vec2(-origin_cell) + size + slack)))
    return -1.0;
  return t;
}

// lod_min: level below which the ray need not go; per_metre: the level at distance t is also log2(t per_metre).
Hit traverse(Ray ray, float t_end, float lod_min, float per_metre) {
  Hit hit;
  hit.found = false;
  hit.t = t_end;
  hit.steps = 0;
  float t = enterDomain(ray);
  if (t < 0.0 || t >= t_end) return hit;
  float t_begin = t;

  float chord_begin = t, chord_end = min(t_end, t + max(chord_metres, chord_growth * t));
  vec3 p = pointOf(ray, t);
  vec3 v = (pointOf(ray, chord_end) - p) / (chord_end - chord_begin);
#if PYRAMID
  int level = last_level;
  ivec2 cell = ivec2(0);
#else
  int level = 0;
  ivec2 cell = clamp(ivec2(floor(p.xy)) + origin_cell, ivec2(0), ivec2(across(0) - 1));
#endif
  int slot = 0;
  ivec2 slot_tile = ivec2(-1);
  int slot_level = last_level;
  int entered = 0;

  for (int i = 0; i < max_steps; ++i) {
    hit.steps = i + 1;
    if (any(lessThan(cell, ivec2(0))) || any(greaterThanEqual(cell, ivec2(across(level))))) return hit;

    float lambda = max(lod_min, log2(max(t * per_metre, 1e-9)));
    lambda = clamp(lambda, 0.0, float(last_level));
    int target = int(floor(lambda));
    if (level < target) {  // further away than this level is for
      ++level;
      cell >>= 1;
      continue;
    }
    if (level < top_level) {
      ivec2 tile = cell >> TILE_LOG2;
      if (level != slot_level || tile != slot_tile) {
        slot = slotOf(level, tile);
        slot_level = level;
        slot_tile = tile;
      }
      if (slot < 0) {  // only coarser here
        ++level;
        cell >>= 1;
        continue;
      }
    }

    // From the cell's entry to its exit, or the chord's end.
    float scale = power2(-level);
    vec2 here = p.xy * scale + originFraction(level) - vec2(cell - originAt(level));  // chord's begin, in the cell
    vec2 speed = v.xy * scale;
    float exit_x = abs(speed.x) < 1e-20 ? 1e30 : chord_begin + ((speed.x > 0.0 ? 1.0 : 0.0) - here.x) / speed.x;
    float exit_y = abs(speed.y) < 1e-20 ? 1e30 : chord_begin + ((speed.y > 0.0 ? 1.0 : 0.0) - here.y) / speed.y;
    float cell_exit = min(exit_x, exit_y);
    float t_out = max(t, min(cell_exit, chord_end));
    float z_in = p.z + v.z * (t - chord_begin), z_out = p.z + v.z * (t_out - chord_begin);
    float low = min(z_in, z_out);
    if (z_in < lowest && v.z < 0.0 && t > t_begin) return hit;  // through a hole: walls end there

    float bound = boundAt(level, cell, slot);
    if (bound > NO_HEIGHT) {
      bool terminal = level <= target;
      if (!terminal && low <= bound) {
        ivec2 child = clamp(ivec2(floor(here * 2.0 + speed * 2.0 * (t - chord_begin))), 0, 1) + 2 * cell;
        int child_slot = level - 1 < top_level ? slotOfCell(level - 1, child) : 0;
        if (child_slot >= 0) {
          --level;
          cell = child;
          slot = child_slot;
          slot_level = level;
          slot_tile = child >> TILE_LOG2;
          continue;
        }
        terminal = true;
      }
      if (terminal) {
        float tau = level == target && level < last_level ? lambda - float(target) : 0.0;
        if (tau > 0.0) {
          ivec2 parent = cell >> 1;
          bound = mix(bound, boundAt(level + 1, parent, parentSlot(level, parent)), tau);
        }
        if (low <= bound) {
          vec2 u0 = clamp(here + speed * (t - chord_begin), 0.0, 1.0);
          vec2 u1 = clamp(here + speed * (t_out - chord_begin), 0.0, 1.0);
          float share = meetSurface(level, cell, slot, tau, u0, u1, z_in, z_out);
          if (share >= 0.0) {
            hit.found = true;
            hit.t = mix(t, t_out, share);
            hit.position = vec3(p.xy + v.xy * (hit.t - chord_begin), mix(z_in, z_out, share));
            hit.level = level;
            hit.cell = cell;
            hit.slot = slot;
            hit.tau = tau;
            hit.local = mix(u0, u1, share);
            hit.entered = entered;
            hit.at_entry = share == 0.0;
            return hit;
          }
        }
      }
    }

    // Ahead.
    t = t_out;
    if ((z_out > highest && v.z >= 0.0) || t >= t_end) return hit;
    if (cell_exit > chord_end) {
      chord_begin = t;
      chord_end = min(t_end, t + max(chord_metres, chord_growth * t));
      p = pointOf(ray, t);
      v = (pointOf(ray, chord_end) - p) / (chord_end - chord_begin);
      entered = 0;
      continue;
    }
    ivec2 old = cell;
    if (exit_x <= exit_y) {
      cell.x += speed.x > 0.0 ? 1 : -1;
      entered = 1;
    } else {
      cell.y += speed.y > 0.0 ? 1 : -1;
      entered = 2;
    }
    // Out of the containing cell: up again. (The thesis goes up after four steps without a hit; this goes up
    // as early as can be without testing the same cell twice.)
#if PYRAMID
    if (level < last_level && (cell >> 1) != (old >> 1)) {
      ++level;
      cell >>= 1;
    }
#endif
  }
  return hit;
}
