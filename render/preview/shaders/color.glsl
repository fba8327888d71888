uniform float max_anisotropy;

// Colour across tiles and levels (thesis, (3.10)-(3.12)). All colours are premultiplied by their alpha.

// Bilinear, at the finest level from `level` on that is here.
vec4 colorAt(vec2 position, int level) {
  const float size = float(TILE);
  int slot = -1;
  vec2 texel;  // within the tile
  for (; level <= last_level; ++level) {
    ivec2 origin = originAt(level);
    ivec2 first = origin >> TILE_LOG2;  // the tile that positions count from
    vec2 from_tile = atLevel(position, level) + vec2(origin - (first << TILE_LOG2));
    vec2 tile = floor(from_tile / size);
    texel = min(from_tile - tile * size, float(across(level)));
    slot = slotOf(level, first + ivec2(tile));
    if (slot >= 0) break;
  }
  if (slot < 0) return vec4(0.0);  // beyond the domain
  ivec3 place = inAtlas(level, ivec2(0), slot, 1);
#if FILTER == 0
  return texelFetch(color_tiles, ivec3(place.xy + ivec2(texel), place.z), 0);
#else
  return textureLod(color_tiles, vec3((vec2(place.xy) + texel) / (float(ATLAS) * (size + 2.0)), float(place.z)), 0.0);
#endif
}

#if FILTER >= 2
vec4 colorBetween(vec2 position, float lod) {
  float level = clamp(floor(lod), 0.0, float(last_level));
  float share = clamp(lod - level, 0.0, 1.0);
  vec4 fine = colorAt(position, int(level));
  if (share == 0.0 || int(level) == last_level) return fine;
  return mix(fine, colorAt(position, int(level) + 1), share);
}
#endif

// dx, dy: how far the position moves from one pixel to the next along the picture's axes, level-0 texels.
// FILTER 0: nearest, 1: bilinear, 2: trilinear, 3: anisotropic with at most max_anisotropy samples.
vec4 filteredColor(vec2 position, vec2 dx, vec2 dy, float finest) {
  float a = dot(dx, dx), b = dot(dy, dy);
  float major = sqrt(max(max(a, b), 1e-12));
#if FILTER == 3
  float minor = sqrt(max(min(a, b), 1e-12));
  float aspect = min(major / minor, max_anisotropy);  // (3.11)
  float lod = max(log2(major / aspect), finest);
  vec2 axis = a > b ? dx : dy;
  int samples = int(ceil(aspect - 0.01));
  if (samples < 1) samples = 1;
  vec4 sum = vec4(0.0);
  for (int i = 0; i < samples; ++i)
    sum += colorBetween(position + axis * ((float(i) + 0.5) / float(samples) - 0.5), lod);
  return sum / float(samples);
#elif FILTER == 2
  return colorBetween(position, max(log2(major), finest));  // (3.10)
#else
  return colorAt(position, int(clamp(floor(max(log2(major), finest) + 0.5), 0.0, float(last_level))));
#endif
}
