// The map on a plain 2-D canvas, for browsers without WebGL and builds without MapLibre GL: north up, no
// terrain, else the same methods as gl_map.js.
import { COMPOSED, RELIEF } from './map_tiles.js';

const SIDE = 256;      // of a tile, in CSS pixels at its own zoom
const AT_ONCE = 4;     // tiles asked for together: the event stream needs one of a browser's six connections
const KEPT = 500;      // tiles in memory
const PATIENCE = 2000; // ms until a tile that could not be had is asked for again
const CLOSER = 3;      // zooms beyond the finest tiles
const TAP = 8;         // CSS pixels that a finger may wander

const worldX = (lng) => lng / 360 + 0.5;
const worldY = (lat) => 0.5 - Math.asinh(Math.tan(lat * Math.PI / 180)) / (2 * Math.PI);
const lngOf = (x) => (x - Math.floor(x)) * 360 - 180;
const latOf = (y) => Math.atan(Math.sinh(Math.PI * (1 - 2 * y))) * 180 / Math.PI;
const clamp = (value, low, high) => Math.max(low, Math.min(high, value));

// The colour of each height above the lowest one, in `steps`.
function ramp(steps) {
  const canvas = document.createElement('canvas');
  canvas.width = steps; canvas.height = 1;
  const ink = canvas.getContext('2d');
  const fill = ink.createLinearGradient(0, 0, steps, 0);
  RELIEF.forEach((colour, i) => fill.addColorStop(i / (RELIEF.length - 1), colour));
  ink.fillStyle = fill;
  ink.fillRect(0, 0, steps, 1);
  return ink.getImageData(0, 0, steps, 1).data;
}

export class FlatMap {
  tilts = false;
  bearing = 0;

  constructor(box, tiles, on) {
    Object.assign(this, { box, tiles, on });
    this.ready = Promise.resolve();
    this.canvas = document.createElement('canvas');
    this.canvas.className = 'flat';
    box.append(this.canvas);
    this.ink = this.canvas.getContext('2d');
    this.x = this.y = 0.5;  // of the middle, in the world's square
    this.zoom = 1;
    this.rasters = [];      // [name, opacity], the lowest first
    this.visible = {};
    this.shapes = {};
    this.kept = new Map();  // 'NAME/Z/X/Y' -> {picture, stale, asked, retry, drawn}
    this.wanted = [];
    this.loading = 0;
    this.drawn = 0;
    this.colours = ramp(256);
    new ResizeObserver(() => this.paint()).observe(box);
    new MutationObserver(() => this.paint()).observe(document.documentElement, { attributes: true, attributeFilter: ['data-theme'] });
    this.listen();
  }

  build() {
    for (const tile of this.kept.values()) tile.picture?.close();
    this.kept.clear();
    this.paint();
  }

  show(ground, layers) {
    const relief = ground === 'relief';
    const shaded = relief || ground === 'both';
    this.rasters = [[relief ? 'elevation' : shaded || ground === 'photo' ? 'color' : ground, 1],
      ...(shaded ? [['hillshade', relief ? 0.75 : 0.55]] : []),
      ...(layers.quality ? [['quality', 0.62]] : []), ...(layers.coverage ? [['coverage', 0.75]] : [])];
    this.visible = { gaps: layers.plan, plan: layers.plan, footprints: layers.footprints, track: layers.track, drone: layers.track };
    this.paint();
  }

  refresh(name, list) {
    const stale = (tile) => { if (tile) { tile.stale = true; tile.retry = 0; } };
    if (list) for (const { z, x, y } of list) stale(this.kept.get(`${name}/${z}/${((x % 2 ** z) + 2 ** z) % 2 ** z}/${y}`));
    else for (const [key, tile] of this.kept) if (key.startsWith(`${name}/`)) stale(tile);
    this.paint();
  }
  refreshAll() { for (const tile of this.kept.values()) tile.stale = true; this.paint(); }

  draw(name, shapes) {
    this.shapes[name] = shapes;
    this.paint();
  }

  fit([west, south, east, north], { top, bottom, left, right }, maxZoom, smooth) {
    const wide = worldX(east < west ? east + 360 : east) - worldX(west), high = worldY(south) - worldY(north);
    const across = Math.max(50, this.box.clientWidth - left - right), down = Math.max(50, this.box.clientHeight - top - bottom);
    const zoom = Math.min(maxZoom, Math.log2(Math.min(across / Math.max(wide, 1e-12), down / Math.max(high, 1e-12)) / SIDE));
    const scale = SIDE * 2 ** zoom;
    this.ease({ x: worldX(west) + wide / 2 + (right - left) / 2 / scale, y: worldY(north) + high / 2 + (bottom - top) / 2 / scale, zoom }, smooth);
  }
  go(lng, lat) { this.ease({ x: this.near(worldX(lng), this.x), y: worldY(lat) }, true); }
  zoomBy(steps) { this.ease({ zoom: this.allowed(this.zoom + steps) }, true); }
  get centre() { return { lat: latOf(this.y), lng: lngOf(this.x) }; }
  get seen() {
    const scale = SIDE * 2 ** this.zoom, wide = this.box.clientWidth / 2 / scale, high = this.box.clientHeight / 2 / scale;
    const west = lngOf(this.x - wide);
    return [west, latOf(this.y + high), west + 720 * wide, latOf(this.y - high)];
  }
  get atRest() { return Boolean(this.tiles.bounds) && !this.frame && !this.easing && !this.loading && !this.wanted.length; }

  // ---- moving ----

  near(x, to) { return x - Math.round(x - to); }
  zooms(name) {
    const doc = name === 'coverage' || name === 'quality' ? this.tiles.extent : this.tiles.doc(name);
    return doc?.bounds ? [Math.max(0, doc.minzoom - COMPOSED), doc.maxzoom] : null;
  }
  allowed(zoom) {
    const extent = this.tiles.extent;
    return clamp(zoom, 0, (extent?.maxzoom ?? 19) + CLOSER);
  }
  ease(to, smooth) {
    cancelAnimationFrame(this.easing);
    this.easing = 0;
    const from = { x: this.x, y: this.y, zoom: this.zoom };
    const begun = performance.now(), ms = smooth ? 350 : 0;
    const step = () => {
      const t = ms ? Math.min(1, (performance.now() - begun) / ms) : 1, s = t * (2 - t);
      for (const key of Object.keys(to)) this[key] = from[key] + s * (to[key] - from[key]);
      this.easing = t < 1 ? requestAnimationFrame(step) : 0;
      this.paint();
    };
    step();
  }
  // Closer or farther with the place below a point of the canvas kept there.
  zoomAt(px, py, zoom) {
    const dx = px - this.box.clientWidth / 2, dy = py - this.box.clientHeight / 2;
    const before = SIDE * 2 ** this.zoom;
    this.zoom = this.allowed(zoom);
    const after = SIDE * 2 ** this.zoom;
    this.x += dx / before - dx / after;
    this.y += dy / before - dy / after;
    this.paint();
  }
  panBy(dx, dy) {
    const scale = SIDE * 2 ** this.zoom;
    this.x -= dx / scale;
    this.y = clamp(this.y - dy / scale, 0, 1);
    this.paint();
  }

  listen() {
    const { canvas } = this;
    const fingers = new Map();
    let moved = 0, most = 0;
    const grip = () => {
      const [a, b = a] = [...fingers.values()];
      return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
    };
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      cancelAnimationFrame(this.easing);
      this.easing = 0;
      if (!fingers.size) moved = most = 0;
      fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
      most = Math.max(most, fingers.size);
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!fingers.has(event.pointerId)) return;
      const before = grip();
      fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
      const after = grip();
      moved += Math.hypot(after.x - before.x, after.y - before.y);
      if (moved > TAP) this.on.grab();
      this.panBy(after.x - before.x, after.y - before.y);
      if (before.apart > 0 && after.apart > 0) this.zoomAt(after.x, after.y, this.zoom + Math.log2(after.apart / before.apart));
    });
    const up = (event) => {
      if (!fingers.delete(event.pointerId) || event.type !== 'pointerup' || fingers.size || most > 1 || moved > TAP) return;
      const scale = SIDE * 2 ** this.zoom;
      this.on.tap(latOf(this.y + (event.offsetY - this.box.clientHeight / 2) / scale), lngOf(this.x + (event.offsetX - this.box.clientWidth / 2) / scale));
    };
    canvas.addEventListener('pointerup', up);
    canvas.addEventListener('pointercancel', up);
    canvas.addEventListener('dblclick', (event) => this.zoomAt(event.offsetX, event.offsetY, this.zoom + 1));
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      this.zoomAt(event.offsetX, event.offsetY, this.zoom - clamp(event.deltaY * lines, -200, 200) / 300);
    }, { passive: false });
  }

  // ---- drawing ----

  paint() { this.frame ||= requestAnimationFrame(() => { this.frame = 0; this.paintNow(); }); }

  paintNow() {
    const { ink, canvas } = this;
    const wide = this.box.clientWidth, high = this.box.clientHeight, ratio = Math.min(devicePixelRatio, 2);
    if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
      canvas.width = Math.round(wide * ratio);
      canvas.height = Math.round(high * ratio);
    }
    ink.setTransform(ratio, 0, 0, ratio, 0, 0);
    ink.clearRect(0, 0, wide, high);
    this.scale = SIDE * 2 ** this.zoom;
    this.left = this.x - wide / 2 / this.scale;
    this.top = this.y - high / 2 / this.scale;
    ++this.drawn;
    this.wanted = [];
    for (const [name, opacity] of this.rasters) {
      ink.globalAlpha = opacity;
      this.paintRaster(name, wide, high, ratio);
    }
    ink.globalAlpha = 1;
    this.paintShapes();
    this.paintScale(wide, high);
    this.ask();
    this.forget();
  }

  paintRaster(name, wide, high, ratio) {
    const zooms = this.zooms(name);
    if (!zooms) return;
    const z = clamp(Math.round(this.zoom + Math.log2(ratio)), ...zooms), n = 2 ** z;
    const right = this.left + wide / this.scale, bottom = this.top + high / this.scale;
    for (let y = Math.max(0, Math.floor(this.top * n)); y < Math.min(n, bottom * n); ++y) {
      for (let x = Math.floor(this.left * n); x < right * n; ++x) {
        const wrapped = ((x % n) + n) % n;
        if (name !== 'coverage' && this.tiles.misses(name, z, wrapped, y)) continue;
        const key = `${name}/${z}/${wrapped}/${y}`;
        const tile = this.kept.get(key);
        if (tile) tile.drawn = this.drawn;
        if (!tile || tile.stale) this.wanted.push({ key, name, z, x: wrapped, y, far: Math.hypot((x + 0.5) / n - this.x, (y + 0.5) / n - this.y) });
        if (tile && !tile.first) this.paintTile(tile.picture, 0, 0, SIDE, x / n, y / n, 1 / n);
        else this.paintKin(name, z, x, y, zooms);
      }
    }
  }
  paintTile(picture, sx, sy, side, x, y, size) {
    if (!picture) return;
    // whole pixels: no seams
    const at = (value, from) => Math.round((value - from) * this.scale);
    const left = at(x, this.left), top = at(y, this.top);
    this.ink.drawImage(picture, sx, sy, side, side, left, top, at(x + size, this.left) - left, at(y + size, this.top) - top);
  }
  // What there is of a tile that is still to come: its part of a coarser one, or finer ones.
  paintKin(name, z, x, y, [lowest]) {
    const held = (tz, tx, ty) => this.kept.get(`${name}/${tz}/${((tx % 2 ** tz) + 2 ** tz) % 2 ** tz}/${ty}`)?.picture;
    for (let up = 1; z - up >= lowest && up <= 6; ++up) {
      const parts = 2 ** up, px = Math.floor(x / parts), py = Math.floor(y / parts);
      const picture = held(z - up, px, py);
      if (!picture) continue;
      this.paintTile(picture, (x - px * parts) * SIDE / parts, (y - py * parts) * SIDE / parts, SIDE / parts, x / 2 ** z, y / 2 ** z, 1 / 2 ** z);
      return;
    }
    const n = 2 ** (z + 1);
    for (const [i, j] of [[0, 0], [1, 0], [0, 1], [1, 1]]) this.paintTile(held(z + 1, 2 * x + i, 2 * y + j), 0, 0, SIDE, (2 * x + i) / n, (2 * y + j) / n, 1 / n);
  }

  paintShapes() {
    const { ink } = this;
    const style = {
      gaps: () => { ink.fillStyle = 'rgba(239, 91, 91, .28)'; ink.fill('evenodd'); },
      plan: () => { ink.setLineDash([8, 5]); this.stroke('#ffd34d', 2.5); ink.setLineDash([]); },
      footprints: () => this.stroke('rgba(127, 227, 255, .55)', 1),
      track: () => { this.stroke('rgba(6, 32, 28, .55)', 5); this.stroke('#38e0c8', 2.5); },
    };
    ink.lineJoin = ink.lineCap = 'round';
    for (const [name, finish] of Object.entries(style)) {
      if (!this.visible[name]) continue;
      ink.beginPath();
      for (const feature of features(this.shapes[name])) this.trace(feature.geometry);
      finish();
    }
    if (!this.visible.drone) return;
    for (const { geometry } of features(this.shapes.drone)) {
      const [px, py] = this.pixel(geometry.coordinates, this.x);
      const dot = (radius, colour) => { ink.beginPath(); ink.arc(px, py, radius, 0, 2 * Math.PI); ink.fillStyle = colour; ink.fill(); };
      dot(15, 'rgba(56, 224, 200, .25)');
      dot(9, '#fff');
      dot(6.5, '#38e0c8');
    }
  }
  stroke(colour, width) { this.ink.strokeStyle = colour; this.ink.lineWidth = width; this.ink.stroke(); }
  // In canvas pixels, on the turn of the world that is nearest to `reference`.
  pixel([lng, lat], reference) {
    const x = this.near(worldX(lng), reference);
    return [(x - this.left) * this.scale, (worldY(lat) - this.top) * this.scale, x];
  }
  trace(geometry) {
    const line = (points) => {
      let reference = this.x;
      points.forEach((point, i) => {
        const [px, py, x] = this.pixel(point, reference);
        reference = x;
        if (i) this.ink.lineTo(px, py); else this.ink.moveTo(px, py);
      });
    };
    if (geometry?.type === 'LineString') line(geometry.coordinates);
    else if (geometry?.type === 'Polygon') geometry.coordinates.forEach(line);
    else if (geometry?.type === 'MultiPolygon') geometry.coordinates.flat().forEach(line);
  }
  paintScale(wide, high) {
    const { ink } = this;
    const metres = 40075016.686 * Math.cos(latOf(this.y) * Math.PI / 180) / this.scale;  // of a pixel
    const most = 120 * metres, power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((step) => step * power <= most) * power;
    const bar = length / metres, right = wide - 14, low = high - (wide > 900 ? 16 : 94);
    const look = getComputedStyle(document.documentElement);
    ink.beginPath();
    ink.moveTo(right - bar, low - 6); ink.lineTo(right - bar, low); ink.lineTo(right, low); ink.lineTo(right, low - 6);
    this.stroke(look.getPropertyValue('--ink'), 2);
    ink.font = '11px system-ui, sans-serif';
    ink.textAlign = 'right';
    ink.fillStyle = look.getPropertyValue('--ink');
    ink.fillText(length >= 1000 ? `${length / 1000} km` : length >= 1 ? `${length} m` : `${Math.round(length * 100)} cm`, right - 5, low - 6);
  }

  // ---- loading ----

  ask() {
    const now = performance.now();
    const next = this.wanted.filter(({ key }) => { const tile = this.kept.get(key); return !tile?.asked && !(tile?.retry > now); }).sort((a, b) => a.far - b.far);
    while (this.loading < AT_ONCE && next.length) this.load(next.shift());
  }

  async load({ key, name, z, x, y }) {
    ++this.loading;
    const tile = this.kept.get(key) ?? { first: true, drawn: this.drawn };
    this.kept.set(key, tile);
    tile.asked = true;
    tile.stale = false;  // a change from now on makes it so again
    try {
      const bytes = await this.tiles.bytes(name, z, x, y);
      const picture = bytes && (name === 'elevation' ? await this.relief(bytes, await this.tiles.bytes('hillshade', z, x, y)) : await image(bytes));
      tile.picture?.close();
      tile.picture = picture;
      tile.first = false;
    } catch {
      tile.stale = true;
      tile.retry = performance.now() + PATIENCE;
      setTimeout(() => this.paint(), PATIENCE + 50);
    }
    tile.asked = false;
    --this.loading;
    this.paint();
  }

  // Terrarium in colours of height. It has no holes; the hillshade of the same place has, and tells them.
  async relief(bytes, shade) {
    if (!shade) return null;
    const heights = await pixels(bytes), mask = await pixels(shade);
    const data = heights.data, step = 255 / this.tiles.heightAbove;
    for (let i = 0; i < data.length; i += 4) {
      const height = data[i] * 256 + data[i + 1] + data[i + 2] / 256 - 32768;
      const colour = 4 * clamp(Math.round(height * step), 0, 255);
      data[i] = this.colours[colour]; data[i + 1] = this.colours[colour + 1]; data[i + 2] = this.colours[colour + 2];
      data[i + 3] = mask.data[i + 3] ? 255 : 0;
    }
    const canvas = new OffscreenCanvas(heights.width, heights.height);
    canvas.getContext('2d').putImageData(heights, 0, 0);
    return canvas.transferToImageBitmap();
  }

  forget() {
    if (this.kept.size <= KEPT) return;
    const oldest = [...this.kept].filter(([, tile]) => !tile.asked && tile.drawn < this.drawn).sort((a, b) => a[1].drawn - b[1].drawn);
    for (const [key, tile] of oldest.slice(0, this.kept.size - KEPT)) { tile.picture?.close(); this.kept.delete(key); }
  }
}

const image = (bytes) => createImageBitmap(new Blob([bytes]), { colorSpaceConversion: 'none', premultiplyAlpha: 'none' });

async function pixels(bytes) {
  const picture = await image(bytes);
  const ink = new OffscreenCanvas(picture.width, picture.height).getContext('2d', { willReadFrequently: true });
  ink.drawImage(picture, 0, 0);
  picture.close();
  return ink.getImageData(0, 0, SIDE, SIDE);
}

function features(shapes) {
  if (!shapes) return [];
  return shapes.type === 'FeatureCollection' ? shapes.features : shapes.type === 'Feature' ? [shapes] : [{ geometry: shapes }];
}
