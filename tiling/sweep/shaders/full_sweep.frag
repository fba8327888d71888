// The thesis' sweep (5.2, 5.3): every plane of the range for every texel, costs over mip levels as windows
// (5.11), all views or the better half (5.5.4); the best plane is kept in a register instead of a depth buffer.
// Ties: the first (lowest) plane wins, and `ambiguous` tells how many planes shared the lowest cost.
uniform sampler2D views[VIEWS];
uniform float lowest_plane;
uniform float plane_step;
uniform int planes;
uniform float first_lod;
layout(location = 0) out vec4 best_out;  // height above the reference, cost, views, planes with that cost

void main() {
  castRays(gl_FragCoord.xy);
  float best_cost = 1e9, best_height = 0.0, best_count = 0.0, ambiguous = 0.0;
  for (int plane = 0; plane < planes; ++plane) {
    float z = lowest_plane + plane_step * float(plane);
    float cost[VIEWS];
    float count = 0.0;
    vec2 where[VIEWS];
    float seen[VIEWS];
    for (int k = 0; k < VIEWS; ++k) {
      vec3 p = ray_origin[k] + z * ray_slope[k];
      where[k] = p.xy / p.z;
      seen[k] = p.z > 0.0 && all(lessThan(abs(where[k] - 0.5), vec2(0.5))) ? 1.0 : 0.0;
      count += seen[k];
      cost[k] = 0.0;
    }
    if (count >= 2.0) {
      for (int level = 0; level < LEVELS; ++level) {
        float value[VIEWS];
#define SAMPLE(k) value[k] = textureLod(views[k], where[k], first_lod + float(level)).r;
  EACH_VIEW(SAMPLE)
        for (int i = 1; i < VIEWS; ++i)
          for (int j = 0; j < i; ++j) {
            float d = value[i] - value[j];
#if COST == 2
            d = d * d * seen[i] * seen[j];
#else
            d = abs(d) * seen[i] * seen[j];
#endif
            cost[i] += d;
            cost[j] += d;
          }
      }
      float total = 0.0;
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
      total /= float(max(kept, 1)) * (count - 1.0);
#else
      for (int k = 0; k < VIEWS; ++k) total += cost[k];
      total /= count * (count - 1.0);
#endif
      if (total < best_cost) {
        best_cost = total;
        best_height = z;
        best_count = count;
        ambiguous = 1.0;
      } else if (total == best_cost) {
        ambiguous += 1.0;
      }
    }
  }
  best_out = vec4(best_height, best_cost, best_count, ambiguous);
}
