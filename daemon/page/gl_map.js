// The map in MapLibre GL: needs WebGL 2. flat_map.js has the same methods and draws without it.
import { COMPOSED, OTHER_CAMERAS, RELIEF } from './map_tiles.js';

const collection = (features) => ({ type: 'FeatureCollection', features });
const RASTERS = ['color', 'elevation', 'hillshade', 'quality', 'coverage', ...OTHER_CAMERAS];
const SKIRT = 1.5;  // metres that a terrain tile's rim reaches down, to hide cracks between levels
const LINES = ['plan', 'gaps', 'footprints', 'track', 'drone'];

function blank(colour) {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 256;
  const ink = canvas.getContext('2d');
  if (colour) { ink.fillStyle = colour; ink.fillRect(0, 0, 256, 256); }
  return new Promise((done) => canvas.toBlob((blob) => blob.arrayBuffer().then(done), 'image/png'));
}

export class GlMap {
  tilts = true;

  // `on`: {tap(lat, lng), grab(), turn(degrees)}. Throws where there is no WebGL 2.
  constructor(box, tiles, on) {
    this.tiles = tiles;
    this.shapes = {};
    const nothing = blank(null);
    const level = blank('rgb(128,0,0)');  // Terrarium for 0 m
    maplibregl.addProtocol('overfly', async (request, abort) => {
      const [name, z, x, y] = request.url.slice('overfly://'.length).split('/');
      const bytes = await tiles.bytes(name, +z, +x, +y, abort.signal);
      return { data: bytes ?? (await (name === 'elevation' ? level : nothing)).slice(0) };
    });
    this.map = new maplibregl.Map({
      container: box, attributionControl: false, maxPitch: 78, fadeDuration: 150, maxTileCacheSize: 400,
      style: { version: 8, sources: {}, layers: [] }, center: [0, 0], zoom: 1, refreshExpiredTiles: false,
    });
    const map = this.map;
    map.addControl(new maplibregl.ScaleControl({ unit: 'metric', maxWidth: 120 }), 'bottom-right');
    map.touchZoomRotate.enableRotation();
    this.ready = new Promise((done) => map.once('load', done));
    map.on('dragstart', () => on.grab());
    map.on('rotate', () => on.turn(map.getBearing()));
    map.on('click', (event) => { const { lat, lng } = event.lngLat.wrap(); on.tap(lat, lng); });
    map.on('error', (event) => console.warn(event.error?.message ?? event));
  }

  addRaster(name, extent, paint) {
    this.map.addSource(name, {
      type: 'raster', tiles: [`overfly://${name}/{z}/{x}/{y}`], tileSize: 256,
      minzoom: Math.max(0, extent.minzoom - COMPOSED), maxzoom: extent.maxzoom,
    });
    this.map.addLayer({ id: name, type: 'raster', source: name, paint: { 'raster-fade-duration': 150, ...paint } });
  }

  // Everything anew, for the zooms that the map has now: a source has its zooms for life.
  build() {
    const { map, tiles } = this;
    const elevation = tiles.doc('elevation');
    map.setTerrain(null);
    for (const layer of map.getStyle().layers) map.removeLayer(layer.id);
    for (const source of Object.keys(map.getStyle().sources)) map.removeSource(source);
    if (tiles.bounds) {
      if (elevation?.bounds) {
        map.addSource('elevation', { type: 'raster-dem', encoding: 'terrarium', tiles: ['overfly://elevation/{z}/{x}/{y}'], tileSize: 256,
          minzoom: Math.max(0, elevation.minzoom - COMPOSED), maxzoom: elevation.maxzoom });
        // what has no height lies at the lowest: shown as nothing
        const top = tiles.heightAbove;
        map.addLayer({ id: 'relief', type: 'color-relief', source: 'elevation', paint: { 'color-relief-color': [
          'interpolate', ['linear'], ['elevation'], 0.6, 'rgba(47,111,94,0)', 0.9, RELIEF[0],
          ...RELIEF.slice(1).flatMap((colour, i) => [0.9 + (top - 0.9) * (i + 1) / (RELIEF.length - 1), colour])] } });
      }
      this.addRaster('color', tiles.extent, {});
      for (const name of OTHER_CAMERAS) if (tiles.doc(name)?.bounds) this.addRaster(name, tiles.doc(name), {});
      if (elevation?.bounds) this.addRaster('hillshade', elevation, {});
      this.addRaster('quality', tiles.extent, { 'raster-opacity': 0.62 });
      this.addRaster('coverage', tiles.extent, { 'raster-opacity': 0.75 });
    }
    for (const name of LINES) map.addSource(name, { type: 'geojson', data: this.shapes[name] ?? collection([]) });
    map.addLayer({ id: 'gaps', type: 'fill', source: 'gaps', paint: { 'fill-color': '#ef5b5b', 'fill-opacity': 0.28 } });
    map.addLayer({ id: 'plan', type: 'line', source: 'plan', paint: { 'line-color': '#ffd34d', 'line-width': 2.5, 'line-dasharray': [3, 2] } });
    map.addLayer({ id: 'footprints', type: 'line', source: 'footprints', paint: { 'line-color': '#7fe3ff', 'line-width': 1, 'line-opacity': 0.55 } });
    map.addLayer({ id: 'track-edge', type: 'line', source: 'track', layout: { 'line-cap': 'round', 'line-join': 'round' }, paint: { 'line-color': '#06201c', 'line-width': 5, 'line-opacity': 0.55 } });
    map.addLayer({ id: 'track', type: 'line', source: 'track', layout: { 'line-cap': 'round', 'line-join': 'round' }, paint: { 'line-color': '#38e0c8', 'line-width': 2.5 } });
    map.addLayer({ id: 'drone-halo', type: 'circle', source: 'drone', paint: { 'circle-radius': 15, 'circle-color': '#38e0c8', 'circle-opacity': 0.25 } });
    map.addLayer({ id: 'drone', type: 'circle', source: 'drone', paint: { 'circle-radius': 7, 'circle-color': '#38e0c8', 'circle-stroke-width': 2.5, 'circle-stroke-color': '#ffffff' } });
  }

  // What is seen: `ground` is 'photo', 'relief', 'both' or another camera's layer, `layers` {name: boolean}.
  show(ground, layers) {
    const { map } = this;
    const set = (id, on) => map.getLayer(id) && map.setLayoutProperty(id, 'visibility', on ? 'visible' : 'none');
    set('color', ground === 'photo' || ground === 'both');
    for (const name of OTHER_CAMERAS) set(name, ground === name);
    set('relief', ground === 'relief');
    set('hillshade', ground === 'relief' || ground === 'both');
    if (map.getLayer('hillshade')) map.setPaintProperty('hillshade', 'raster-opacity', ground === 'relief' ? 0.75 : 0.55);
    set('quality', layers.quality);
    set('coverage', layers.coverage);
    set('footprints', layers.footprints);
    for (const id of ['track', 'track-edge', 'drone', 'drone-halo']) set(id, layers.track);
    set('plan', layers.plan);
    set('gaps', layers.plan);
  }

  // Tiles of a layer that are new, all of it without `list`. The old picture stays until the new one is there.
  refresh(name, list) {
    if ((list && !list.length) || !this.map.getSource(name)) return;
    this.map.refreshTiles(name, list);
  }
  refreshAll() { for (const name of RASTERS) this.refresh(name); }

  // 'plan', 'gaps', 'footprints', 'track' or 'drone': GeoJSON, null for none.
  draw(name, shapes) {
    this.shapes[name] = shapes ?? collection([]);
    this.map.getSource(name)?.setData(this.shapes[name]);
  }

  // `bounds`: [west, south, east, north], east below west across the antimeridian.
  fit([west, south, east, north], padding, maxZoom, smooth) {
    this.map.fitBounds([[west, south], [east < west ? east + 360 : east, north]],
      { padding, maxZoom, duration: smooth ? 700 : 0, pitch: this.map.getPitch(), bearing: this.map.getBearing() });
  }
  go(lng, lat) { this.map.easeTo({ center: [lng, lat], duration: 600 }); }
  zoomBy(steps) { if (steps > 0) this.map.zoomIn(); else this.map.zoomOut(); }
  northUp() { this.map.easeTo({ bearing: 0 }); }
  tilt(on) {
    if (on && this.map.getSource('elevation')) {
      this.map.setTerrain({ source: 'elevation', exaggeration: 1 });
      // MapLibre's own skirts reach down hundreds of metres: a wall wherever the map ends at a tile's border.
      if (this.map.terrain?.getMeshFrameDelta) this.map.terrain.getMeshFrameDelta = () => SKIRT;
    } else {
      this.map.setTerrain(null);
    }
    this.map.easeTo({ pitch: on ? 58 : 0, bearing: on ? this.map.getBearing() : 0, duration: 700 });
  }
  get centre() { const { lat, lng } = this.map.getCenter().wrap(); return { lat, lng }; }
  get bearing() { return (this.map.getBearing() + 360) % 360; }
  // [west, south, east, north], degrees.
  get seen() { const b = this.map.getBounds(); return [b.getWest(), b.getSouth(), b.getEast(), b.getNorth()]; }
  // All tiles that are seen are there.
  get atRest() { return Boolean(this.map.getSource('color')) && this.map.loaded() && this.map.areTilesLoaded(); }
}
