// The rays of a texel into the views: view k sees the texel's point at height z (metres above the grid's
// reference height) at ray_origin[k] + z * ray_slope[k], homogeneous, in texture coordinates of the image.
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
  for (int k = 0; k < VIEWS; ++k) {
    for (int row = 0; row < 3; ++row) {
      vec4 m = view_matrix[3 * k + row];
      ray_origin[k][row] = dot(m.xyz, point) + m.w;
      ray_slope[k][row] = dot(m.xyz, direction);
    }
  }
}
