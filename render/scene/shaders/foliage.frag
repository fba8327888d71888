in vec3 place;
in vec2 uv;
in float depth_in_crown;
flat in vec3 normal;
flat in float metres;
flat in uvec2 plant;
flat in uint clump;
#ifndef SHADOW_MAP
layout(location = 0) out vec4 color;
#endif
void main() {
  if (leafCover(uv, metres, clump) <= 0.0) discard;
#ifndef SHADOW_MAP
  vec2 dx = dFdx(uv) * metres;
  vec2 dy = dFdy(uv) * metres;
  float width = sqrt(max(dot(dx, dx), dot(dy, dy)));
  vec3 albedo = leafAlbedo(plant.x, plant.y, uv, metres, clamp(depth_in_crown, 0.0, 1.0), width, clump);
  color = vec4(encoded(radianceOf(albedo, normal, towards_sun, litShare(place, normal))), 1.0);
#endif
}
