in vec3 place;
in vec3 normal;
layout(location = 0) out vec4 color;
void main() {
  Footprint f = footprintOf(dFdx(place.xy), dFdy(place.xy));
  vec3 albedo = vec3(0.0);
  for (int i = 0; i < f.taps; ++i) {
    albedo += groundAlbedo(place.xy + ((float(i) + 0.5) / float(f.taps) - 0.5) * f.longer, f.width);
  }
  vec3 n = normalize(normal);
  float lit = litShare(place, n);
  vec3 radiance = radianceOf(albedo / float(f.taps), n, towards_sun, lit);
#ifdef SPECULAR
  for (int once = 0; once < (baseAt(place.xy) == 7u ? 1 : 0); ++once) {
    radiance += vec3(glint(place, waveNormal(place.xy, f.width), specular.y, lit));
  }
#endif
  color = vec4(encoded(radiance), 1.0);
}
