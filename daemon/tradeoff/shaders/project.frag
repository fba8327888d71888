// Pixel of every texel of a tile: polynomials of degree 5 and 4 in s, t = -1..1 (geo::TileFrame) in whatever
// frame the uniforms are, all in float32.
uniform vec3 ground[21];
uniform vec3 up[15];
uniform vec4 image_from_frame[3];
uniform float height;
uniform float size;
layout(location = 0) out highp vec4 pixel;

void main() {
  vec2 texel = floor(gl_FragCoord.xy) + 0.5;
  float s = 2.0 * texel.x / size - 1.0, t = 2.0 * texel.y / size - 1.0;
  float powers_s[6], powers_t[6];
  powers_s[0] = powers_t[0] = 1.0;
  for (int i = 1; i < 6; ++i) {
    powers_s[i] = powers_s[i - 1] * s;
    powers_t[i] = powers_t[i - 1] * t;
  }
  vec3 point = vec3(0.0), direction = vec3(0.0);
  int term = 0;
  for (int degree = 0; degree < 6; ++degree)
    for (int k = 0; k <= degree; ++k) {
      point += powers_s[degree - k] * powers_t[k] * ground[term];
      if (degree < 5) direction += powers_s[degree - k] * powers_t[k] * up[term];
      ++term;
    }
  point += height * direction;
  vec3 image = vec3(dot(image_from_frame[0].xyz, point) + image_from_frame[0].w,
                    dot(image_from_frame[1].xyz, point) + image_from_frame[1].w,
                    dot(image_from_frame[2].xyz, point) + image_from_frame[2].w);
  pixel = vec4(image.xy / image.z, image.z, 1.0);
}
