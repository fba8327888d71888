// The cover map for material.glsl (cover.h).
uniform highp usampler2D cover_map;
uniform vec2 cover_origin;
uniform float cover_texels_per_metre;
uniform float kerb_width;
uniform float street_lines;
uint coverTexel(int x, int y) { return texelFetch(cover_map, clamp(ivec2(x, y), ivec2(0), textureSize(cover_map, 0) - 1), 0).r; }
vec2 coverOrigin() { return cover_origin; }
float coverTexelsPerMetre() { return cover_texels_per_metre; }
float kerbWidth() { return kerb_width; }
float streetLines() { return street_lines; }
