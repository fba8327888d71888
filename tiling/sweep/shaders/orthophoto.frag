// True orthophoto of a block of texels: each texel's point on the surface is looked for in the views that see
// it, and coloured by the one that looks most steeply, with a soft change-over where two are nearly as good.
// On a surface that is only a guess views do not meet: `fallback` says what is made of several (thesis 5.4,
// figure 5.6).
#define IMAGE_CENTRE 0  // the one that sees the point nearest to its image's centre
#define BLEND 1         // all, less towards the border of an image
#define AVERAGE 2       // all alike
#define OVERWRITE 3     // the last
#define LOWEST_COST 4   // the one that differs least from the others
uniform sampler2D views[VIEWS];
uniform sampler2D provisional;  // 1 where the surface is only a guess
uniform vec4 surface_from_texel;  // scale.xy and offset.zw: texture coordinates of a texel's centre
uniform vec3 camera[VIEWS];       // in tile ENU
uniform float gain[VIEWS];        // exposure gain of the frame, linear in coded values
uniform float worth[VIEWS];       // of the frame as a whole: sharpness, exposure; about 1
uniform float focal[VIEWS];       // pixels
uniform int fallback;
layout(location = 0) out vec4 color_out;
layout(location = 1) out vec4 source_out;  // source + 1, views that see the texel, flags (1: provisional), -
layout(location = 2) out vec4 detail_out;  // GSD in metres of the source, its tilt in radians, -, -

float score[VIEWS];
vec2 where[VIEWS];
float seen_by;
vec3 tint[VIEWS];

// How much a view is worth on a guessed surface.
float rankOnGuess(int k, float edge, vec2 from_centre) {
  float rim = min(1.0, edge * 20.0);
  if (fallback == BLEND) return worth[k] * edge;
  if (fallback == AVERAGE) return worth[k];
  if (fallback == OVERWRITE) return float(k + 1);
  return worth[k] * rim / (0.03 + dot(from_centre, from_centre));
}

void main() {
  castRays(gl_FragCoord.xy);
  vec2 at = gl_FragCoord.xy * surface_from_texel.xy + surface_from_texel.zw;
  float z = textureLod(surface, at, 0.0).r;
  bool guess = textureLod(provisional, at, 0.0).r > 0.5;
  float s = grid_origin.x + gl_FragCoord.x * grid_step, t = grid_origin.y + gl_FragCoord.y * grid_step;
  vec3 point = ground[0] + s * (ground[1] + s * ground[3] + t * ground[4]) + t * (ground[2] + t * ground[5]);
  vec3 normal = up[0];
  point += z * normal;
  float best = 0.0;
  int source = -1;
  seen_by = 0.0;
#define LOOK(k) { \
    vec3 p = ray_origin[k] + z * ray_slope[k]; \
    where[k] = p.xy / p.z; \
    vec2 inside = 0.5 - abs(where[k] - 0.5); \
    float edge = min(inside.x, inside.y); \
    score[k] = 0.0; \
    if (p.z > 0.0 && edge > 0.0 && textureLod(views[k], where[k], 0.0).a > 0.99) { \
      if (guess) { \
        seen_by += 1.0; \
        vec2 from_centre = (where[k] - 0.5) * vec2(textureSize(views[k], 0)) / focal[k]; \
        score[k] = rankOnGuess(k, edge, from_centre); \
        if (fallback == LOWEST_COST) tint[k] = gain[k] * textureLod(views[k], where[k], 0.0).rgb; \
      } else { \
        vec3 ray = camera[k] - point; \
        float tangent2 = dot(ray.xy, ray.xy) / max(ray.z * ray.z, 1e-6); \
        score[k] = worth[k] * min(1.0, edge * 20.0) / (0.03 + tangent2); \
      } \
    } \
  }
#if VIEWS > 0
  LOOK(0)
#endif
#if VIEWS > 1
  LOOK(1)
#endif
#if VIEWS > 2
  LOOK(2)
#endif
#if VIEWS > 3
  LOOK(3)
#endif
#if VIEWS > 4
  LOOK(4)
#endif
#if VIEWS > 5
  LOOK(5)
#endif
#if VIEWS > 6
  LOOK(6)
#endif
#if VIEWS > 7
  LOOK(7)
#endif
#if VIEWS > 8
  LOOK(8)
#endif
#if VIEWS > 9
  LOOK(9)
#endif
#if VIEWS > 10
  LOOK(10)
#endif
#if VIEWS > 11
  LOOK(11)
#endif
#if VIEWS > 12
  LOOK(12)
#endif
#if VIEWS > 13
  LOOK(13)
#endif
  // A view that does not see the point still counts where none does.
  for (int k = 0; k < VIEWS; ++k) {
    if (score[k] > 0.0 && !guess) {
      if (isHidden(at, z, point, camera[k], 1.5, 0.35 * march_step, 0.05))
        score[k] *= 1e-3;
      else
        seen_by += 1.0;
    }
    if (score[k] > best) {
      best = score[k];
      source = k;
    }
  }
  if (guess && fallback == LOWEST_COST && source >= 0) {
    float lowest = 1e9;
    for (int i = 0; i < VIEWS; ++i) {
      if (score[i] <= 0.0) continue;
      float cost = 0.0;
      for (int j = 0; j < VIEWS; ++j)
        if (score[j] > 0.0) cost += dot(abs(tint[i] - tint[j]), vec3(1.0));
      if (cost < lowest) { lowest = cost; source = i; }
    }
  }
  bool all_count = guess && (fallback == BLEND || fallback == AVERAGE);
  bool one_counts = guess && (fallback == OVERWRITE || fallback == LOWEST_COST);
  vec3 color = vec3(0.0);
  float total = 0.0;
#define MIX(k) { \
    float share = all_count ? score[k] : one_counts ? float(k == source) : \
                  smoothstep(BLEND_FROM, 1.0, score[k] / best); \
    if (share > 0.0) { color += share * gain[k] * textureLod(views[k], where[k], 0.0).rgb; total += share; } \
  }
  if (source >= 0) {
#if VIEWS > 0
  MIX(0)
#endif
#if VIEWS > 1
  MIX(1)
#endif
#if VIEWS > 2
  MIX(2)
#endif
#if VIEWS > 3
  MIX(3)
#endif
#if VIEWS > 4
  MIX(4)
#endif
#if VIEWS > 5
  MIX(5)
#endif
#if VIEWS > 6
  MIX(6)
#endif
#if VIEWS > 7
  MIX(7)
#endif
#if VIEWS > 8
  MIX(8)
#endif
#if VIEWS > 9
  MIX(9)
#endif
#if VIEWS > 10
  MIX(10)
#endif
#if VIEWS > 11
  MIX(11)
#endif
#if VIEWS > 12
  MIX(12)
#endif
#if VIEWS > 13
  MIX(13)
#endif
  }
  color_out = total > 0.0 ? vec4(color / total, 1.0) : vec4(0.0);
  vec3 ray = source >= 0 ? camera[source] - point : vec3(0.0, 0.0, 1.0);
  source_out = vec4(float(source + 1), seen_by, guess ? 1.0 : 0.0, 0.0) / 255.0;
  detail_out = vec4(source >= 0 ? length(ray) / focal[source] : 0.0, atan(length(ray.xy), ray.z), 0.0, 0.0);
}
