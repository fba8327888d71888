// The thesis' sweep (5.2, 5.3): every plane of the range for every texel, costs over mip levels as windows
// (5.11), all views or the better half (5.5.4); the best plane is kept in a register instead of a depth buffer.
// Ties: the first (lowest) plane wins, and `ambiguous` tells how many planes shared the lowest cost.
uniform sampler2D views[VIEWS];
uniform float lowest_plane;
uniform float plane_step;
uniform int planes;
layout(location = 0) out vec4 best_out;  // height above the reference, cost, views, planes with that cost

#if COST == 2
#define DIFFERENCE(i, j) (value[i] - value[j]) * (value[i] - value[j])
#else
#define DIFFERENCE(i, j) abs(value[i] - value[j])
#endif

void main() {
  castRays(gl_FragCoord.xy);
  float best_cost = 1e9, best_height = 0.0, best_count = 0.0, ambiguous = 0.0;
  for (int plane = 0; plane < planes; ++plane) {
    float z = lowest_plane + plane_step * float(plane);
    float count = 0.0;
    vec2 where[VIEWS];
    float seen[VIEWS];
    float value[VIEWS];
    // Arrays over views are indexed by constants alone, and no branch stands around the reads: both cost a
    // software rasteriser more than they save.
#define LOOK(k) { \
    vec3 p = ray_origin[k] + z * ray_slope[k]; \
    where[k] = p.xy / p.z; \
    seen[k] = p.z > 0.0 && all(lessThan(abs(where[k] - 0.5), vec2(0.5))) ? 1.0 : 0.0; \
    count += seen[k]; \
  }
    EACH_VIEW(LOOK)
    float total = 0.0;
#ifdef BETTER_HALF
    float cost[VIEWS];
    for (int k = 0; k < VIEWS; ++k) cost[k] = 0.0;
#define PAIR(i, j) { float d = DIFFERENCE(i, j) * seen[i] * seen[j]; cost[i] += d; cost[j] += d; }
#else
#define PAIR(i, j) total += DIFFERENCE(i, j) * seen[i] * seen[j];
#endif
#define SAMPLE(k) value[k] = textureLod(views[k], where[k], float(level)).r;
    for (int level = 0; level < LEVELS; ++level) {
      EACH_VIEW(SAMPLE)
      EACH_PAIR(PAIR)
    }
#ifdef BETTER_HALF
    int kept = int(count) / 2;
    for (int k = 0; k < VIEWS; ++k) cost[k] = seen[k] > 0.0 ? cost[k] : 1e9;
    for (int chosen = 0; chosen < kept; ++chosen) {
      int lowest = 0;
      for (int k = 1; k < VIEWS; ++k)
        if (cost[k] < cost[lowest]) lowest = k;
      total += cost[lowest];
      cost[lowest] = 1e9;
    }
    total /= float(max(kept, 1)) * max(count - 1.0, 1.0);
#else
    total *= 2.0 / max(count * (count - 1.0), 1.0);
#endif
    bool better = count >= 2.0 && total < best_cost;
    ambiguous = better ? 1.0 : ambiguous + (count >= 2.0 && total == best_cost ? 1.0 : 0.0);
    best_cost = better ? total : best_cost;
    best_height = better ? z : best_height;
    best_count = better ? count : best_count;
  }
  best_out = vec4(best_height, best_cost, best_count, ambiguous);
}
