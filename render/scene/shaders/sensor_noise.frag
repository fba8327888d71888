uniform vec2 sensor_electrons;  // electrons at white, read noise in electrons (1 sigma)
uniform uint seed;              // of the effect and the frame
// Two standard normals (Box-Muller) from two hashes.
vec2 normals(uint a, uint b) {
  float r = sqrt(-2.0 * log(max(unitOf(a), 1e-7)));
  float phi = 6.2831853 * unitOf(b);
  return r * vec2(cos(phi), sin(phi));
}
void main() {
  ivec2 p = pixel();
  uint h = cellHash(p.x, p.y, seed);
  uint a = mixBits(h + 1u);
  uint b = mixBits(h + 0x9e3779b9u);
  uint c = mixBits(h + 0x3c6ef372u);
  uint d = mixBits(h + 0xdaa66d2bu);
  vec2 first = normals(a, b);
  vec3 n = vec3(first, normals(c, d).x);
  vec3 electrons = linearOf(here()) * sensor_electrons.x;
  electrons += n * sqrt(electrons + sensor_electrons.y * sensor_electrons.y);  // shot noise: Poisson, as normal
  color = vec4(encodedOf(electrons / sensor_electrons.x), 1.0);
}
