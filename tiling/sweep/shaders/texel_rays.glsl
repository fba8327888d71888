// The rays of a texel into the views: view k sees the texel's point at height z (metres above the grid's
// reference height) at ray_origin[k] + z * ray_slope[k], homogeneous, in texture coordinates of the image.
// EACH_VIEW(F) is F(0) F(1) ... F(VIEWS - 1), EACH_PAIR(F) is F(1, 0) F(2, 0) F(2, 1) ...: arrays over views
// are indexed by constants alone, so that they live in registers.
// The grid's position polynomials are in s, t = -1..1 over the cell (geo::TileFrame), ground already raised to
// the reference height; grid_origin and grid_step give s, t of a texel.
uniform vec2 grid_origin;
uniform float grid_step;
uniform vec3 ground[10];  // degree 3 in s, t
uniform vec3 up[6];       // degree 2
uniform vec4 view_matrix[3 * VIEWS];  // rows of image_from_grid, 3x4
vec3 ray_origin[VIEWS];
vec3 ray_slope[VIEWS];

void castRays(vec2 texel) {
  float s = grid_origin.x + texel.x * grid_step;
  float t = grid_origin.y + texel.y * grid_step;
  vec3 point = ground[0] + s * (ground[1] + s * (ground[3] + s * ground[6]) + t * (ground[4] + s * ground[7])) +
               t * (ground[2] + t * (ground[5] + s * ground[8] + t * ground[9]));
  vec3 direction = up[0] + s * (up[1] + s * up[3] + t * up[4]) + t * (up[2] + t * up[5]);
#define ROW(k, row, v) dot(view_matrix[3 * k + row].xyz, v)
#define CAST(k) \
  ray_origin[k] = vec3(ROW(k, 0, point), ROW(k, 1, point), ROW(k, 2, point)) + \
                  vec3(view_matrix[3 * k].w, view_matrix[3 * k + 1].w, view_matrix[3 * k + 2].w); \
  ray_slope[k] = vec3(ROW(k, 0, direction), ROW(k, 1, direction), ROW(k, 2, direction));
  EACH_VIEW(CAST)
}
