// Colour of the surface's steep sides from photographs (thesis, chapter 6), PROJECTORS of them, 1 .. 8.
#if PROJECTORS > 0
uniform highp sampler2DArray projector_images;  // premultiplied by alpha, with mip levels
// Columns 0 .. 2 take a direction (East-North-Up) to (u w, v w, w), w the depth, u and v from 0 to 1 over the
// photograph; column 3 is its centre of projection, metres from the camera.
uniform mat4x3 projector[PROJECTORS];
uniform float projector_detail[PROJECTORS];  // its focal length in pixels over this picture's
uniform float projector_layer[PROJECTORS];
uniform float grazing;  // sine of the angle to the surface below which a photograph comes after all others
uniform vec2 lateral;  // cosines of the slopes up to which the orthophoto, and from which photographs alone colour

const float NOWHERE = 1e30, GRAZES = 1e9;

// Of the photographs that show a hit the one taken nearest to it (6.2.3), found out by secondary rays (6.2.2),
// from the nearest on: the first that reaches its centre ends the search. Those that see it at a grazing angle,
// smeared, come last. Alpha 0: none shows it.
// `from`: where the rays begin, in the map's coordinates from hit.place, a little above the surface.
vec4 projectedColor(Hit hit, vec3 direction, vec3 normal, vec3 from, float finest) {
  vec3 place = hit.t * direction;
  float away[PROJECTORS];
  for (int k = 0; k < PROJECTORS; ++k) {
    vec3 way = projector[k][3] - place;
    vec3 p = mat3(projector[k]) * -way;
    bool inside = p.z > 0.0 && p.x >= 0.0 && p.y >= 0.0 && p.x <= p.z && p.y <= p.z;
    float d = length(way), facing = dot(way, normal);
    away[k] = !inside || facing <= 0.0 ? NOWHERE : facing < grazing * d ? GRAZES * d : d;
  }
  for (int tries = 0; tries < PROJECTORS; ++tries) {
    int nearest = 0;
    for (int k = 1; k < PROJECTORS; ++k)
      if (away[k] < away[nearest]) nearest = k;
    if (away[nearest] >= NOWHERE) break;
    away[nearest] = NOWHERE;
    vec3 to = projector[nearest][3] - place;
    float d = length(to);
    to /= d;
    // The ray's straight line as the map's coordinates bend it there.
    vec3 along = per_metre * to +
                 2.0 * hit.t * vec3(dot(to, bend_x * direction), dot(to, bend_y * direction), dot(to, bend_z * direction));
    Ray ray = Ray(hit.place, from.xy, vec2(from.z, 0.0), along, vec3(0.0), curve(to));
    if (traverse(ray, d, finest, 0.0).found) continue;
    vec3 p = mat3(projector[nearest]) * (-d * to);
    // A pixel of this picture over one of the photograph's, each for a cell that is a cube, as l_opt.
    float level = log2(max(projector_detail[nearest] * hit.t / d, 1.0));
    vec4 sampled = textureLod(projector_images, vec3(p.xy / p.z, projector_layer[nearest]), level);
    if (sampled.a > 0.5) return vec4(sampled.rgb / sampled.a, 1.0);
  }
  return vec4(0.0);
}
#endif
