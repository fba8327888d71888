uniform vec3 gains;  // linear, per channel
void main() { color = vec4(encodedOf(linearOf(here()) * gains), 1.0); }
