// One texel, seven planes around its own height: the agreement of all views that see it, per plane, before
// aggregation over the support window. Channels: planes -3..0 in `first`, 1..3 and the texture strength (mean
// square of the values at plane 0) in `second`.
// COST 0: locally normalised correlation, mean over pairs of v_i v_j (5.3 with the normalisation done once per
//         image instead of per window); 1: minus mean absolute difference over pairs (5.6);
//      2: minus mean squared difference over pairs (5.1); 3: census, minus mean Hamming distance over pairs.
// Pair sums come from sums over views: sum_{i != j} v_i v_j = S^2 - Q.
// BETTER_HALF: of the views that see the texel only the half that agrees best with all others counts (5.5.4).
// OCCLUDERS: hidden_views names, as bits of a whole number, the views that do not count at a texel.
uniform sampler2D views[VIEWS];
uniform sampler2D base_height;
uniform float plane_step;
uniform float height_offset;
uniform float lod[VIEWS];
#ifdef OCCLUDERS
uniform sampler2D hidden_views;
int hidden;
#define NOT_HIDDEN(k) && (hidden & (1 << k)) == 0
#else
#define NOT_HIDDEN(k)
#endif
layout(location = 0) out vec4 first;
layout(location = 1) out vec4 second;

float strength;

#if COST == 3
vec3 texel_dx[VIEWS];
vec3 texel_dy[VIEWS];
#endif

float planeAgreement(float z) {
  float count = 0.0, sum = 0.0, squares = 0.0, differences = 0.0;
  float value[VIEWS];
  float seen[VIEWS];
#if COST == 3
  int code[VIEWS];
#endif
#define SAMPLE(k) { \
    vec3 p = ray_origin[k] + z * ray_slope[k]; \
    vec2 uv = p.xy / p.z; \
    float v = textureLod(views[k], uv, lod[k]).r; \
    bool valid = p.z > 0.0 && all(lessThan(abs(uv - 0.5), vec2(0.5))) && v > 0.002 NOT_HIDDEN(k); \
    seen[k] = valid ? 1.0 : 0.0; \
    v = (v - 0.50196) * seen[k]; \
    value[k] = v; \
    count += seen[k]; \
    sum += v; \
    squares += v * v; \
    CENSUS(k) \
  }
#if COST == 3
#define NEIGHBOUR(k, dx, dy, bit) { \
    vec3 n = p + dx * texel_dx[k] + dy * texel_dy[k]; \
    bits += textureLod(views[k], n.xy / n.z, lod[k]).r - 0.50196 > v ? bit : 0; \
  }
#define CENSUS(k) int bits = 0; \
  NEIGHBOUR(k, -1.0, -1.0, 1) NEIGHBOUR(k, 0.0, -1.0, 2) NEIGHBOUR(k, 1.0, -1.0, 4) NEIGHBOUR(k, -1.0, 0.0, 8) \
  NEIGHBOUR(k, 1.0, 0.0, 16) NEIGHBOUR(k, -1.0, 1.0, 32) NEIGHBOUR(k, 0.0, 1.0, 64) NEIGHBOUR(k, 1.0, 1.0, 128) \
  code[k] = bits;
#else
#define CENSUS(k)
#endif
  EACH_VIEW(SAMPLE)
  if (count < 2.0) return NO_VIEWS;
  float pairs = count * (count - 1.0);
#ifdef BETTER_HALF
  strength = squares / count;
  // Of each view: its agreement with all others, summed.
  float with_others[VIEWS];
  for (int k = 0; k < VIEWS; ++k) {
#if COST == 0
    with_others[k] = value[k] * (sum - value[k]);
#elif COST == 2
    with_others[k] = -(count * value[k] * value[k] - 2.0 * value[k] * sum + squares);
#else
    with_others[k] = 0.0;
#endif
  }
#if COST == 1 || COST == 3
  for (int i = 1; i < VIEWS; ++i)
    for (int j = 0; j < i; ++j) {
#if COST == 1
      float d = seen[i] * seen[j] * abs(value[i] - value[j]);
#else
      float d = seen[i] * seen[j] * float(bitCount(code[i] ^ code[j])) / 8.0;
#endif
      with_others[i] -= d;
      with_others[j] -= d;
    }
#endif
  for (int k = 0; k < VIEWS; ++k) with_others[k] = seen[k] > 0.0 ? with_others[k] : -1e9;
  int kept = int(count) / 2;
  float total = 0.0;
  for (int chosen = 0; chosen < kept; ++chosen) {
    int best = 0;
    for (int k = 1; k < VIEWS; ++k)
      if (with_others[k] > with_others[best]) best = k;
    total += with_others[best];
    with_others[best] = -2e9;
  }
  return total / (float(kept) * (count - 1.0));
#elif COST == 0
  strength = squares / count;
  return (sum * sum - squares) / pairs;
#elif COST == 2
  strength = squares / count;
  return -2.0 * (count * squares - sum * sum) / pairs;
#else
#if COST == 1
#define DIFFER(i, j) differences += seen[i] * seen[j] * abs(value[i] - value[j]);
#else
#define DIFFER(i, j) differences += seen[i] * seen[j] * float(bitCount(code[i] ^ code[j])) / 8.0;
#endif
  EACH_PAIR(DIFFER)
  strength = squares / count;
  return -2.0 * differences / pairs;
#endif
}

void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy);
  float z = texelFetch(base_height, texel, 0).r + height_offset;
  castRays(gl_FragCoord.xy);
#if COST == 3
  for (int k = 0; k < VIEWS; ++k)
    for (int row = 0; row < 3; ++row) {
      texel_dx[k][row] = dot(view_matrix[3 * k + row].xyz, ground[1]) * grid_step;
      texel_dy[k][row] = dot(view_matrix[3 * k + row].xyz, ground[2]) * grid_step;
    }
#endif
#ifdef OCCLUDERS
  hidden = int(texelFetch(hidden_views, texel, 0).r);
#endif
  strength = 0.0;
  first.w = planeAgreement(z);
  float texture_strength = strength;
  first.xyz = vec3(planeAgreement(z - 3.0 * plane_step), planeAgreement(z - 2.0 * plane_step),
                   planeAgreement(z - plane_step));
  second = vec4(planeAgreement(z + plane_step), planeAgreement(z + 2.0 * plane_step),
                planeAgreement(z + 3.0 * plane_step), texture_strength);
  first *= HALF_FLOAT_SCALE;
  second *= HALF_FLOAT_SCALE;
}
