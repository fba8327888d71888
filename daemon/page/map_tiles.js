// The link's tiles: which there are, and their bytes. Both views of the map (gl_map.js, flat_map.js) ask here.
export const COMPOSED = 4;  // coarser zooms than the stored ones that the server composes
export const OTHER_CAMERAS = ['thermal', 'near_infrared'];  // layers like colour, that few maps have

// Heights of a map from its lowest to its highest.
export const RELIEF = ['#2f6f5e', '#5f9f6b', '#b9c77a', '#dcb873', '#b98052', '#8d5a44', '#efe9e4'];

const lonOf = (x, z) => x / 2 ** z * 360 - 180;
const latOf = (y, z) => Math.atan(Math.sinh(Math.PI * (1 - 2 * y / 2 ** z))) * 180 / Math.PI;

export class Tiles {
  base = '';    // '' or 'm/ID/'
  info = null;  // /tiles.json

  // TileJSON of a layer.
  doc(name) { return this.info?.layers.find((layer) => layer.tiles[0].includes(`/tiles/${name}/`)); }
  // What the whole map takes: that of its colours, or of its heights while there are none.
  get extent() { return this.doc('color')?.bounds ? this.doc('color') : this.doc('elevation'); }
  get bounds() { return this.extent?.bounds; }
  // Heights are shown above this level, in metres: the ground of a view is at 0.
  get minus() { return Math.floor((this.doc('elevation')?.height_range ?? [0])[0]) - 1; }
  get heightAbove() { return Math.max(2, (this.doc('elevation')?.height_range ?? [0, 100])[1] - this.minus); }

  misses(name, z, x, y) {
    const bounds = this.doc(name)?.bounds;
    if (!bounds) return name !== 'coverage';
    const [west, south, east, north] = bounds;
    if (latOf(y, z) <= south || latOf(y + 1, z) >= north) return true;
    if (west > east) return lonOf(x, z) >= east && lonOf(x + 1, z) <= west;
    return lonOf(x, z) >= east || lonOf(x + 1, z) <= west;
  }

  // An image's bytes; null: nothing is there. Rejects when the server does not answer.
  async bytes(name, z, x, y, signal) {
    if (name !== 'coverage' && this.misses(name, z, x, y)) return null;
    const file = name === 'elevation' ? `webp?minus=${this.minus}` : 'webp';
    const answer = await fetch(`${this.base}tiles/${name}/${z}/${x}/${y}.${file}`, { signal, cache: 'no-cache' });
    return answer.ok ? answer.arrayBuffer() : null;
  }

  // Stored tiles that changed ([layer, z, x, y, ...]) as the link's tiles of each layer that is shown:
  // {color: [{z, x, y}], elevation, hillshade, quality, ...}.
  changed(tiles) {
    const shift = Math.log2((this.info?.tile_size ?? 256) / 256);
    const wanted = Object.fromEntries(['color', 'elevation', 'quality', ...OTHER_CAMERAS].map((name) => [name, new Map()]));
    for (const [name, z, x, y] of tiles) {
      const set = wanted[name];
      if (!set) continue;
      const put = (tz, tx, ty) => set.set(`${tz}/${tx}/${ty}`, { z: tz, x: tx, y: ty });
      const parts = 2 ** shift;
      for (let j = 0; j < parts; ++j) for (let i = 0; i < parts; ++i) put(z + shift, x * parts + i, y * parts + j);
      const lowest = this.doc(name)?.minzoom ?? 0;
      if (z + shift === lowest) {
        for (let up = 1; up <= COMPOSED; ++up) put(z + shift - up, Math.floor(x * parts / 2 ** up), Math.floor(y * parts / 2 ** up));
      }
    }
    // a hillshade reads its neighbours' border
    const shade = new Map(wanted.elevation);
    for (const t of wanted.elevation.values()) {
      for (const [dx, dy] of [[-1, 0], [1, 0], [0, -1], [0, 1]]) shade.set(`${t.z}/${t.x + dx}/${t.y + dy}`, { z: t.z, x: t.x + dx, y: t.y + dy });
    }
    return Object.fromEntries(Object.entries({ ...wanted, hillshade: shade }).map(([name, set]) => [name, [...set.values()]]));
  }
}
