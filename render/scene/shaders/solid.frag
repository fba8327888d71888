in vec3 place;
in vec2 at;
flat in vec3 normal;
flat in uint surface;
layout(location = 0) out vec4 color;
void main() {
  Footprint f = footprintOf(dFdx(at), dFdy(at));
  vec3 albedo = vec3(0.0);
  for (int i = 0; i < f.taps; ++i) {
    albedo += solidAlbedo(surface & 255u, surface >> 8, at + ((float(i) + 0.5) / float(f.taps) - 0.5) * f.longer, f.width);
  }
  float lit = litShare(place, normal);
  vec3 radiance = radianceOf(albedo / float(f.taps), normal, towards_sun, lit);
#ifdef SPECULAR
  // Glass: the windows of plaster walls, and cars.
  if ((surface & 255u) == 8u) radiance += vec3(glint(place, normal, 0.05, lit));
#endif
  color = vec4(encoded(radiance), 1.0);
}
