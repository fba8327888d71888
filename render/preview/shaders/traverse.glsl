// Rays through the maximum pyramid, cell by cell, down and up (thesis, 4.2.2 and 4.2.3).
//
// A float holds a ten-millionth of a number, a millimetre at ten kilometres. So nothing here is a distance from
// the camera: a ray's curve is followed in chords, each of which begins at a whole cell and a fraction that
// are exact to 1e-5 of a texel whatever the distance, and all else is counted from there.
uniform float lowest, highest;  // of all surfaces, with a margin
uniform float chord_metres, chord_growth;
uniform int max_steps;

const int START_ABOVE = 4;  // levels above its own that a ray begins at: measured, bench_preview

// At distance t: start + t along + t^2 bend; texels, texels, metres.
struct Ray {
  ivec2 cell;      // the start: a cell of level 0 from the domain's corner ...
  vec2 fraction;   // ... a place in it ...
  vec2 height;     // ... and a height, the sum of two floats
  vec3 along, along_rest;  // their sum, too
  vec3 bend;
};

struct Chord {
  ivec2 cell;      // where it begins
  vec2 fraction;
  float height;
  float begin;     // distance along the ray
  float length;
  vec3 speed;      // per metre
};

struct Hit {
  bool found;
  float t;         // metres from the ray's start
  ivec2 place;     // cell of level 0
  vec3 fraction;   // in it, and the height
  int level;
  ivec2 cell;      // of that level
  int slot;
  float tau;       // share of the next coarser level
  vec2 local;      // within the cell
  int entered;     // how the ray came into the cell: 0 otherwise, 1 across a west or east border, 2 north or south
  bool at_entry;   // on the border itself: a wall
  int steps;       // cells that were looked at
};
vec2 positionOf(Hit hit) { return vec2(hit.place - origin_cell) + hit.fraction.xy; }

// To twelve significant bits, towards zero: the product of two such numbers is exact.
float shortened(float x) { return uintBitsToFloat(floatBitsToUint(x) & 0xFFFFF000u); }
vec3 shortened(vec3 x) { return uintBitsToFloat(floatBitsToUint(x) & uvec3(0xFFFFF000u)); }

// The chord from distance t = shortened(t) on, to t_end at most.
Chord chordFrom(Ray ray, float t, float t_end) {
  Chord chord;
  chord.begin = t;
  float next = shortened(t + max(chord_metres, chord_growth * t));
  chord.length = min(next, t_end) - t;
  vec3 head = shortened(ray.along), rest = (ray.along - head) + ray.along_rest;
  vec3 far = t * head, near = t * (rest + t * ray.bend);
  vec2 whole = floor(far.xy);
  vec2 place = ray.fraction + (far.xy - whole) + near.xy;
  vec2 more = floor(place);
  chord.cell = ray.cell + ivec2(whole) + ivec2(more);
  chord.fraction = place - more;
  chord.height = (ray.height.x + far.z) + (ray.height.y + near.z);
  chord.speed = ray.along + (2.0 * t + chord.length) * ray.bend;
  return chord;
}

// The distance beyond which a + b t + c t^2 = x is passed towards x, for |c t| << |b|.
float crossing(float a, float b, float c, float x) {
  float t = (x - a) / b;
  for (int i = 0; i < 3; ++i) t -= (a + t * (b + t * c) - x) / (b + 2.0 * t * c);
  return t;
}

// About the first distance at which the ray is inside the domain's box; negative: never.
float enterDomain(Ray ray) {
  float t = 0.0;
  if (ray.height.x > highest) {
    // The height is convex in t: the ground falls away.
    float a = ray.bend.z, b = ray.along.z, c = ray.height.x - highest;
    float root = b * b - 4.0 * a * c;
    if (b >= 0.0 || root < 0.0) return -1.0;
    t = 2.0 * c / (sqrt(root) - b);
  }
  vec2 west = -vec2(ray.cell), east = west + float(across(0));  // borders, from the start's cell
  for (int k = 0; k < 2; ++k) {
    float at = ray.fraction[k] + t * (ray.along[k] + t * ray.bend[k]);
    if (at >= west[k] && at <= east[k]) continue;
    float to = at < west[k] ? west[k] : east[k];
    if (ray.along[k] == 0.0 || (to - at) * ray.along[k] < 0.0) return -1.0;
    t = max(t, crossing(ray.fraction[k], ray.along[k], ray.bend[k], to));
  }
  // Past a corner: by the time that one side is entered another has been left.
  vec2 p = ray.fraction + t * (ray.along.xy + t * ray.bend.xy), slack = 0.02 + 1e-6 * abs(p);
  if (any(lessThan(p, west - slack)) || any(greaterThan(p, east + slack))) return -1.0;
  return t;
}

// How far along its first chord a ray enters the box.
float enterOn(Chord chord) {
  float s = 0.0;
  if (chord.height > highest && chord.speed.z < 0.0) s = (highest - chord.height) / chord.speed.z;
  for (int k = 0; k < 2; ++k) {
    if (chord.cell[k] < 0 && chord.speed[k] > 0.0)
      s = max(s, (float(-chord.cell[k]) - chord.fraction[k]) / chord.speed[k]);
    if (chord.cell[k] >= across(0) && chord.speed[k] < 0.0)
      s = max(s, (float(across(0) - chord.cell[k]) - chord.fraction[k]) / chord.speed[k]);
  }
  return min(s, chord.length);
}

// lod_min: level below which the ray need not go; per_metre: the level at distance t is also log2(t per_metre).
//
// Three loops, because a rasteriser in software runs all of a loop's body for every pixel of a group: the
// search for a cell whose bound the ray does not pass above, then, where the search came to a chord's end, the
// next chord, then the surface in the cell.
Hit traverse(Ray ray, float t_end, float lod_min, float per_metre) {
  Hit hit;
  hit.found = false;
  hit.t = t_end;
  hit.steps = 0;
  float t_enter = enterDomain(ray);
  if (t_enter < 0.0 || t_enter >= t_end) return hit;

  const int ENDED = 0, NEXT_CHORD = 1, SURFACE_MAY_BE_HIT = 2;
  Chord chord = chordFrom(ray, shortened(max(t_enter * (1.0 - 1e-6), 0.0)), t_end);
  float s = enterOn(chord), s_out = s;
  float s_first = s;  // on the first chord; negative on later ones
  ivec2 cell = clamp(chord.cell + ivec2(floor(chord.fraction + chord.speed.xy * s)), ivec2(0), ivec2(across(0) - 1));
#if PYRAMID
  // Not from the one texel that is the last level: its bound skips next to nothing.
  float begin_lod = max(lod_min, log2(max((chord.begin + s) * per_metre, 1e-9)));
  int level = clamp(int(begin_lod) + START_ABOVE, 0, last_level);
  cell >>= level;
#else
  int level = 0;
#endif
  int slot = 0, entered = 0;
  bool done = false;       // with the cell
  bool coarsest = false;   // finer levels of it are not here
  float parent_bound = 1e30;
  vec2 here = vec2(0.0), speed = vec2(0.0), exits = vec2(0.0);
  float tau = 0.0;

  for (;;) {
    int found = ENDED;
    for (;;) {
      vec2 slope = mix(1.0 / chord.speed.xy, vec2(1e20), lessThan(abs(chord.speed.xy), vec2(1e-20)));
      vec2 ahead = mix(vec2(0.0), vec2(1.0), greaterThan(slope, vec2(0.0)));
      ivec2 way = ivec2(sign(slope));
      found = ENDED;
      for (; hit.steps < max_steps; ++hit.steps) {
        if (done) {
          s = s_out;
          if (chord.height + chord.speed.z * s > highest && chord.speed.z >= 0.0) break;
          if (min(exits.x, exits.y) >= chord.length) {
            found = NEXT_CHORD;
            break;
          }
          done = false;
          coarsest = false;
          ivec2 old = cell;
          if (exits.x <= exits.y) {
            cell.x += way.x;
            entered = 1;
          } else {
            cell.y += way.y;
            entered = 2;
          }
          // Out of the containing cell: up again. (The thesis goes up after four steps without a hit; this
          // goes up as early as can be without testing the same cell twice.)
#if PYRAMID
          if (level < last_level && (cell >> 1) != (old >> 1)) {
            ++level;
            cell >>= 1;
            parent_bound = 1e30;
          }
#endif
          if (any(lessThan(cell, ivec2(0))) || any(greaterThanEqual(cell, ivec2(across(level))))) break;
        }
        float lambda = max(lod_min, log2(max((chord.begin + s) * per_metre, 1e-9)));
        lambda = clamp(lambda, 0.0, float(last_level));
        int target = int(floor(lambda));
        if (level < target) {  // further away than this level is for
          cell >>= target - level;
          level = target;
          parent_bound = 1e30;
        }
        slot = slotOfCell(level, cell);
        if (slot < 0) {  // only coarser here
          ++level;
          cell >>= 1;
          coarsest = true;
          parent_bound = 1e30;
          continue;
        }
        // From the cell's entry to its exit, or the chord's end.
        float scale = power2(-level);
        here = (chord.fraction + vec2(chord.cell & ((1 << level) - 1))) * scale - vec2(cell - (chord.cell >> level));
        speed = chord.speed.xy * scale;
        exits = (ahead - here) * slope * power2(level);
        s_out = max(s, min(min(exits.x, exits.y), chord.length));
        float z_in = chord.height + chord.speed.z * s, z_out = chord.height + chord.speed.z * s_out;
        if (z_in < lowest && chord.speed.z < 0.0 && s > s_first) break;  // through a hole: walls end there
        float bound = boundAt(level, cell, slot), limit = bound;
        bool terminal = level <= target || coarsest;
        tau = level == target && level < last_level ? lambda - float(target) : 0.0;
        if (tau > 0.0) limit = mix(bound, max(parent_bound, bound), tau);
        done = true;
        if (bound < NO_HEIGHT || min(z_in, z_out) > limit) continue;
        if (terminal) {
          found = SURFACE_MAY_BE_HIT;
          break;
        }
        done = false;
        parent_bound = bound;
        cell = 2 * cell + clamp(ivec2(floor(2.0 * (here + speed * s))), 0, 1);
        --level;
      }
      if (found != NEXT_CHORD) break;
      if (chord.begin + chord.length >= t_end) {
        found = ENDED;
        break;
      }
      chord = chordFrom(ray, chord.begin + chord.length, t_end);
      s = 0.0;
      s_first = -1.0;
      entered = 0;
      done = false;
    }
    if (found == ENDED) return hit;

    ++hit.steps;
    float z_in = chord.height + chord.speed.z * s, z_out = chord.height + chord.speed.z * s_out;
    vec2 u_in = clamp(here + speed * s, 0.0, 1.0), u_out = clamp(here + speed * s_out, 0.0, 1.0);
    float share = meetSurface(level, cell, slot, tau, u_in, u_out, z_in, z_out);
    if (share >= 0.0) {
      hit.found = true;
      s = mix(s, s_out, share);
      hit.t = chord.begin + s;
      vec2 place = chord.fraction + chord.speed.xy * s;
      hit.place = chord.cell + ivec2(floor(place));
      hit.fraction = vec3(place - floor(place), mix(z_in, z_out, share));
      hit.level = level;
      hit.cell = cell;
      hit.slot = slot;
      hit.tau = tau;
      hit.local = mix(u_in, u_out, share);
      hit.entered = entered;
      hit.at_entry = share == 0.0;
      return hit;
    }
  }
}

// For the programs that hand hits back: cell and fraction; height, distance, steps, and level with two flags.
void reportHit(Hit hit, out uvec4 where, out uvec4 how) {
  where = hit.found ? uvec4(uvec2(hit.place), floatBitsToUint(hit.fraction.xy)) : uvec4(0u);
  how = uvec4(0u, 0u, uint(hit.steps), uint(hit.steps >= max_steps) << 1);
  if (hit.found) how = uvec4(floatBitsToUint(vec2(hit.fraction.z, hit.t)), uint(hit.steps), (uint(hit.level) << 2) | how.w | 1u);
}
