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
uniform sampler2D surface;        // heights above the reference, as fine as the grid or coarser, with apron
uniform sampler2D provisional;    // 1 where the surface is only a guess
uniform sampler2D hidden_views;   // bit k: hidden from view k; the surface's texels without apron
uniform float hidden_from_texel;
uniform vec4 surface_from_texel;  // scale.xy and offset.zw: texture coordinates of a texel's centre
uniform vec3 camera[VIEWS];       // in tile ENU
uniform float gain[VIEWS];        // exposure gain of the frame, linear in coded values
uniform float worth[VIEWS];       // of the frame as a whole: sharpness, exposure; about 1
uniform float focal[VIEWS];       // pixels
layout(location = 0) out vec4 color_out;
layout(location = 1) out vec4 source_out;  // source + 1, views that see the texel, flags (1: provisional), -
layout(location = 2) out vec4 detail_out;  // GSD in metres of the source, its tilt in radians, -, -

float score[VIEWS];
vec2 where[VIEWS];
#if FALLBACK == LOWEST_COST
vec3 tint[VIEWS];
#define TINT(k) tint[k] = gain[k] * textureLod(views[k], where[k], 0.0).rgb;
#else
#define TINT(k)
#endif

// How much view k is worth on a guessed surface.
#if FALLBACK == BLEND
#define RANK_ON_GUESS(k) worth[k] * edge
#elif FALLBACK == AVERAGE
#define RANK_ON_GUESS(k) worth[k]
#elif FALLBACK == OVERWRITE
#define RANK_ON_GUESS(k) float(k + 1)
#else
#define RANK_ON_GUESS(k) worth[k] * rim / (0.03 + dot(from_centre, from_centre))
#endif

void main() {
  castRays(gl_FragCoord.xy);
  vec2 at = gl_FragCoord.xy * surface_from_texel.xy + surface_from_texel.zw;
  float z = textureLod(surface, at, 0.0).r;
  bool guess = textureLod(provisional, at, 0.0).r > 0.5;
  int hidden = int(texelFetch(hidden_views, ivec2(gl_FragCoord.xy * hidden_from_texel), 0).r);
  float s = grid_origin.x + gl_FragCoord.x * grid_step, t = grid_origin.y + gl_FragCoord.y * grid_step;
  vec3 point = ground[0] + s * (ground[1] + s * ground[3] + t * ground[4]) + t * (ground[2] + t * ground[5]);
  point += z * up[0];
  float best = 0.0, seen_by = 0.0, source_focal = 1.0;
  int source = -1;
  vec3 source_ray = vec3(0.0, 0.0, 1.0);
  // A view that does not see the point still counts where none does.
#define LOOK(k) { \
    vec3 p = ray_origin[k] + z * ray_slope[k]; \
    where[k] = p.xy / p.z; \
    vec2 inside = 0.5 - abs(where[k] - 0.5); \
    float edge = min(inside.x, inside.y); \
    float rim = min(1.0, edge * 20.0); \
    bool usable = p.z > 0.0 && edge > 0.0 && textureLod(views[k], where[k], 0.0).a > 0.99; \
    bool sees = guess || (hidden & (1 << k)) == 0; \
    vec3 ray = camera[k] - point; \
    vec2 from_centre = (where[k] - 0.5) * vec2(textureSize(views[k], 0)) / focal[k]; \
    float tangent2 = dot(ray.xy, ray.xy) / max(ray.z * ray.z, 1e-6); \
    float rank = guess ? RANK_ON_GUESS(k) : worth[k] * rim / (0.03 + tangent2); \
    score[k] = usable ? (sees ? rank : rank * 1e-3) : 0.0; \
    seen_by += usable && sees ? 1.0 : 0.0; \
    TINT(k) \
    if (score[k] > best) { best = score[k]; source = k; source_ray = ray; source_focal = focal[k]; } \
  }
  EACH_VIEW(LOOK)
#if FALLBACK == LOWEST_COST
  if (guess && source >= 0) {
    float lowest = 1e9;
    for (int i = 0; i < VIEWS; ++i) {
      if (score[i] <= 0.0) continue;
      float cost = 0.0;
      for (int j = 0; j < VIEWS; ++j)
        if (score[j] > 0.0) cost += dot(abs(tint[i] - tint[j]), vec3(1.0));
      if (cost < lowest) { lowest = cost; source = i; }
    }
    source_ray = camera[source] - point;
    source_focal = focal[source];
  }
#endif
#if FALLBACK == BLEND || FALLBACK == AVERAGE
#define SHARE(k) guess ? score[k] : smoothstep(BLEND_FROM, 1.0, score[k] / best)
#elif FALLBACK == OVERWRITE || FALLBACK == LOWEST_COST
#define SHARE(k) guess ? float(k == source) : smoothstep(BLEND_FROM, 1.0, score[k] / best)
#else
#define SHARE(k) smoothstep(BLEND_FROM, 1.0, score[k] / best)
#endif
  vec3 color = vec3(0.0);
  float total = 0.0;
  // A loop of one round, because a software rasteriser reads the image behind an `if` for every pixel, but
  // leaves a loop that none of those it works on at once enters.
#define MIX(k) { \
    float share = SHARE(k); \
    for (int round = share > 0.0 ? 0 : 1; round < 1; ++round) { \
      color += share * gain[k] * textureLod(views[k], where[k], 0.0).rgb; \
      total += share; \
    } \
  }
  if (source >= 0) {
    EACH_VIEW(MIX)
  }
  color_out = total > 0.0 ? vec4(color / total, 1.0) : vec4(0.0);
  source_out = vec4(float(source + 1), seen_by, guess ? 1.0 : 0.0, 0.0) / 255.0;
  detail_out = vec4(source >= 0 ? length(source_ray) / source_focal : 0.0,
                    atan(length(source_ray.xy), source_ray.z), 0.0, 0.0);
}
