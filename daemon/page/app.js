// The operator page: MapLibre GL over the link's own tiles. Everything it needs comes from this server.
import { Camera } from './camera.js';
import { Live } from './live.js';
import { area, fillMissions, firstTheme, note, pressed, showContact, showCoverage, showHeight, showLegend, showStatus, theme } from './panels.js';

const $ = (id) => document.getElementById(id);
const layers = { track: true, footprints: false, coverage: false, quality: false, plan: true };
let ground = 'photo';
let mission = null;   // the one shown; null: the current one
let base = '';        // '' or 'm/ID/'
let info = null;      // /tiles.json
let minus = 0;        // heights are shown above this level: MapLibre's ground is at 0
let lastFrame = null;
let isLive = false;
const track = { frames: [], last: null };

firstTheme();

// ---- tiles: asked of the server only where the map is ----

const COMPOSED = 4;  // coarser zooms than the stored ones that the server composes
const doc = (name) => info?.layers.find((l) => l.tiles[0].includes(`/tiles/${name}/`));

function blank(colour) {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 256;
  const ink = canvas.getContext('2d');
  if (colour) { ink.fillStyle = colour; ink.fillRect(0, 0, 256, 256); }
  return new Promise((done) => canvas.toBlob((blob) => blob.arrayBuffer().then(done), 'image/png'));
}
const nothing = blank(null);
const level = blank('rgb(128,0,0)');  // Terrarium for 0 m

const lonOf = (x, z) => x / 2 ** z * 360 - 180;
const latOf = (y, z) => Math.atan(Math.sinh(Math.PI * (1 - 2 * y / 2 ** z))) * 180 / Math.PI;

function missesMap(name, z, x, y) {
  const bounds = doc(name)?.bounds;
  if (!bounds) return name !== 'coverage';
  const [west, south, east, north] = bounds;
  if (latOf(y, z) <= south || latOf(y + 1, z) >= north) return true;
  if (west > east) return lonOf(x, z) >= east && lonOf(x + 1, z) <= west;
  return lonOf(x, z) >= east || lonOf(x + 1, z) <= west;
}

// overfly://LAYER/Z/X/Y
maplibregl.addProtocol('overfly', async (request, abort) => {
  const [name, z, x, y] = request.url.slice('overfly://'.length).split('/');
  const empty = () => (name === 'elevation' ? level : nothing).then((data) => ({ data: data.slice(0) }));
  if (name !== 'coverage' && missesMap(name, +z, +x, +y)) return empty();
  const file = name === 'elevation' ? `webp?minus=${minus}` : 'webp';
  const answer = await fetch(`${base}tiles/${name}/${z}/${x}/${y}.${file}`, { signal: abort.signal, cache: 'no-cache' });
  if (!answer.ok) return empty();
  return { data: await answer.arrayBuffer() };
});

// ---- the map ----

const map = new maplibregl.Map({
  container: 'map', attributionControl: false, maxPitch: 78, fadeDuration: 150, maxTileCacheSize: 400,
  style: { version: 8, sources: {}, layers: [] }, center: [0, 0], zoom: 1, refreshExpiredTiles: false,
});
map.addControl(new maplibregl.ScaleControl({ unit: 'metric', maxWidth: 120 }), 'bottom-right');
map.touchZoomRotate.enableRotation();

const collection = (features) => ({ type: 'FeatureCollection', features });
const ready = new Promise((done) => map.once('load', done));

function addRaster(name, extent, paint) {
  map.addSource(name, {
    type: 'raster', tiles: [`overfly://${name}/{z}/{x}/{y}`], tileSize: 256,
    minzoom: Math.max(0, extent.minzoom - COMPOSED), maxzoom: extent.maxzoom,
  });
  map.addLayer({ id: name, type: 'raster', source: name, paint: { 'raster-fade-duration': 150, ...paint } });
}

// Sources have their zooms for life; a map that grows a finer level gets new ones.
let built = null;
function buildLayers() {
  const color = doc('color');
  const elevation = doc('elevation');
  const extent = color?.bounds ? color : elevation;
  const signature = extent?.bounds ? `${mission}/${info.map}/${extent.minzoom}-${extent.maxzoom}-${Boolean(elevation?.bounds)}` : '';
  if (signature === built) return;
  const first = built === null || built === '';
  built = signature;
  map.setTerrain(null);
  for (const layer of map.getStyle().layers) map.removeLayer(layer.id);
  for (const source of Object.keys(map.getStyle().sources)) map.removeSource(source);
  if (extent?.bounds) {
    if (elevation?.bounds) {
      const [low, high] = elevation.height_range ?? [0, 100];
      minus = Math.floor(low) - 1;
      const dem = { type: 'raster-dem', encoding: 'terrarium', tiles: ['overfly://elevation/{z}/{x}/{y}'], tileSize: 256,
        minzoom: Math.max(0, elevation.minzoom - COMPOSED), maxzoom: elevation.maxzoom };
      map.addSource('elevation', dem);
      // what has no height lies at the lowest: shown as nothing
      const top = Math.max(2, high - minus);
      const ramp = ['#2f6f5e', '#5f9f6b', '#b9c77a', '#dcb873', '#b98052', '#8d5a44', '#efe9e4'];
      map.addLayer({ id: 'relief', type: 'color-relief', source: 'elevation', paint: { 'color-relief-color': [
        'interpolate', ['linear'], ['elevation'], 0.6, 'rgba(47,111,94,0)', 0.9, ramp[0],
        ...ramp.slice(1).flatMap((colour, i) => [0.9 + (top - 0.9) * (i + 1) / (ramp.length - 1), colour])] } });
    }
    addRaster('color', extent, {});
    if (elevation?.bounds) addRaster('hillshade', elevation, {});
    addRaster('quality', extent, { 'raster-opacity': 0.62 });
    addRaster('coverage', extent, { 'raster-opacity': 0.75 });
  }
  for (const name of ['plan', 'gaps', 'footprints', 'track', 'drone']) map.addSource(name, { type: 'geojson', data: collection([]) });
  map.addLayer({ id: 'gaps', type: 'fill', source: 'gaps', paint: { 'fill-color': '#ef5b5b', 'fill-opacity': 0.28 } });
  map.addLayer({ id: 'plan', type: 'line', source: 'plan', paint: { 'line-color': '#ffd34d', 'line-width': 2.5, 'line-dasharray': [3, 2] } });
  map.addLayer({ id: 'footprints', type: 'line', source: 'footprints', paint: { 'line-color': '#7fe3ff', 'line-width': 1, 'line-opacity': 0.55 } });
  map.addLayer({ id: 'track-edge', type: 'line', source: 'track', layout: { 'line-cap': 'round', 'line-join': 'round' }, paint: { 'line-color': '#06201c', 'line-width': 5, 'line-opacity': 0.55 } });
  map.addLayer({ id: 'track', type: 'line', source: 'track', layout: { 'line-cap': 'round', 'line-join': 'round' }, paint: { 'line-color': '#38e0c8', 'line-width': 2.5 } });
  map.addLayer({ id: 'drone-halo', type: 'circle', source: 'drone', paint: { 'circle-radius': 15, 'circle-color': '#38e0c8', 'circle-opacity': 0.25 } });
  map.addLayer({ id: 'drone', type: 'circle', source: 'drone', paint: { 'circle-radius': 7, 'circle-color': '#38e0c8', 'circle-stroke-width': 2.5, 'circle-stroke-color': '#ffffff' } });
  applyLayers();
  drawTrack();
  refreshPlan();
  if (pressed($('tilt'))) setTilt(true);
  if (first && extent?.bounds) fit(false);
}

function applyLayers() {
  const show = (id, on) => map.getLayer(id) && map.setLayoutProperty(id, 'visibility', on ? 'visible' : 'none');
  show('color', ground !== 'relief');
  show('relief', ground === 'relief');
  show('hillshade', ground !== 'photo');
  if (map.getLayer('hillshade')) map.setPaintProperty('hillshade', 'raster-opacity', ground === 'relief' ? 0.75 : 0.55);
  show('quality', layers.quality);
  show('coverage', layers.coverage);
  show('footprints', layers.footprints);
  for (const id of ['track', 'track-edge', 'drone', 'drone-halo']) show(id, layers.track);
  show('plan', layers.plan);
  show('gaps', layers.plan);
  showLegend(layers);
}

function fit(smooth = true) {
  const bounds = (doc('color')?.bounds ?? doc('elevation')?.bounds);
  if (!bounds) return;
  const [west, south, east, north] = bounds;
  const wide = innerWidth > 900;
  map.fitBounds([[west, south], [east < west ? east + 360 : east, north]], {
    padding: { top: 90, bottom: 100, left: wide ? 60 : 20, right: 80 }, maxZoom: (doc('color')?.maxzoom ?? 20) + 1,
    duration: smooth ? 700 : 0, pitch: map.getPitch(), bearing: map.getBearing() });
}

function setTilt(on) {
  pressed($('tilt'), on);
  if (on && map.getSource('elevation')) map.setTerrain({ source: 'elevation', exaggeration: 1 });
  else map.setTerrain(null);
  map.easeTo({ pitch: on ? 58 : 0, bearing: on ? map.getBearing() : 0, duration: 700 });
}

// ---- what changes ----

// Stored tiles that changed, to the link's tiles of each source. MapLibre keeps the old picture until the new
// one is there.
function refresh(tiles) {
  const shift = Math.log2((info?.tile_size ?? 256) / 256);
  const wanted = { color: new Map(), elevation: new Map(), quality: new Map() };
  for (const [name, z, x, y] of tiles) {
    const set = wanted[name];
    if (!set) continue;
    const put = (tz, tx, ty) => set.set(`${tz}/${tx}/${ty}`, { z: tz, x: tx, y: ty });
    const parts = 2 ** shift;
    for (let j = 0; j < parts; ++j) for (let i = 0; i < parts; ++i) put(z + shift, x * parts + i, y * parts + j);
    const lowest = doc(name)?.minzoom ?? 0;
    if (z + shift === lowest) {
      for (let up = 1; up <= COMPOSED; ++up) put(z + shift - up, Math.floor(x * parts / 2 ** up), Math.floor(y * parts / 2 ** up));
    }
  }
  // a hillshade reads its neighbours' border
  const shade = new Map(wanted.elevation);
  for (const t of wanted.elevation.values()) {
    for (const [dx, dy] of [[-1, 0], [1, 0], [0, -1], [0, 1]]) shade.set(`${t.z}/${t.x + dx}/${t.y + dy}`, { z: t.z, x: t.x + dx, y: t.y + dy });
  }
  const ask = (source, set) => { if (set.size && map.getSource(source)) map.refreshTiles(source, [...set.values()]); };
  ask('color', wanted.color);
  ask('elevation', wanted.elevation);
  ask('hillshade', shade);
  ask('quality', wanted.quality);
}

async function getJson(path) {
  const answer = await fetch(path, { cache: 'no-cache' });
  return answer.ok ? answer.json() : null;
}

// Several events within a moment are one look at the server.
function gather(action, pause) {
  let timer = null;
  return () => { timer ??= setTimeout(async () => { timer = null; await action().catch(() => {}); }, pause); };
}

const refreshInfo = gather(loadInfo, 1500);
async function loadInfo() {
  const next = await getJson(`${base}tiles.json`);
  if (!next) return;
  info = next;
  await ready;
  buildLayers();
}

const refreshTrack = gather(loadTrack, 1000);
async function loadTrack() {
  for (;;) {
    const answer = await getJson(`${base}track${track.last === null ? '' : `?after=${track.last}`}`);
    if (!answer) return;
    track.frames.push(...answer.frames);
    if (answer.frames.length) track.last = answer.frames.at(-1).id;
    if (!answer.more) break;
  }
  drawTrack();
}

function drawTrack() {
  if (!map.getSource('track')) return;
  const points = track.frames.filter((f) => f.lat !== undefined).map((f) => [f.lon, f.lat]);
  map.getSource('track').setData(collection(points.length > 1 ? [{ type: 'Feature', properties: {}, geometry: { type: 'LineString', coordinates: points } }] : []));
  lastFrame = points.at(-1) ?? null;
  map.getSource('drone').setData(collection(lastFrame ? [{ type: 'Feature', properties: {}, geometry: { type: 'Point', coordinates: lastFrame } }] : []));
  map.getSource('footprints').setData(collection(track.frames.slice(-400).filter((f) => f.footprint).map((f) => (
    { type: 'Feature', properties: {}, geometry: { type: 'LineString', coordinates: [...f.footprint, f.footprint[0]] } }))));
  if (pressed($('follow')) && lastFrame) map.easeTo({ center: lastFrame, duration: 600 });
}

const refreshCoverage = gather(async () => {
  const report = await getJson(`${base}coverage.json`);
  showCoverage(report);
  if (report && map.getSource('gaps')) map.getSource('gaps').setData(report.gaps);
  if (layers.coverage && map.getSource('coverage')) map.refreshTiles('coverage');
}, 2500);

async function refreshPlan() {
  const plan = await getJson(`${base}plan`).catch(() => null);
  map.getSource('plan')?.setData(plan ?? collection([]));
  refreshCoverage();
}

async function loadMissions() {
  const answer = await getJson('missions');
  const list = answer?.missions ?? [];
  const shown = list.find((m) => m.id === mission) ?? list.find((m) => m.current);
  fillMissions(list, shown?.id);
  isLive = Boolean(shown?.live);
  document.title = shown ? `${shown.name} · overfly` : 'overfly';
  return list;
}

async function showMission(id, list) {
  const chosen = list.find((m) => m.id === id);
  mission = chosen && !chosen.current ? id : null;
  base = mission ? `m/${mission}/` : '';
  isLive = Boolean(chosen?.live);
  track.frames = [];
  track.last = null;
  built = null;
  await loadInfo();
  await loadTrack();
  await loadMissions();
}

let frameCount = -1;
const live = {
  change(tiles) {
    if (mission !== null) return;
    refresh(tiles);
    refreshInfo();
    refreshTrack();
    refreshCoverage();
  },
  resync() {
    if (mission !== null) return;
    refreshInfo();
    refreshTrack();
    refreshCoverage();
    for (const source of ['color', 'elevation', 'hillshade', 'quality', 'coverage']) if (map.getSource(source)) map.refreshTiles(source);
  },
  async mission() {
    note('A new mission has begun');
    await showMission(null, await loadMissions());
  },
  status(status) {
    isLive = mission === null && Boolean(status.mission?.live);
    showStatus(status);
    const frames = status.map?.frames ?? 0;
    if (frames !== frameCount && mission === null) {
      frameCount = frames;
      refreshTrack();
      refreshCoverage();
      if (!info || !built) refreshInfo();
    }
  },
  contact(seconds) { showContact(seconds, isLive); },
};

// ---- controls ----

$('fit').onclick = () => fit();
$('follow').onclick = () => { const on = !pressed($('follow')); pressed($('follow'), on); if (on && lastFrame) map.easeTo({ center: lastFrame }); };
$('tilt').onclick = () => setTilt(!pressed($('tilt')));
$('north').onclick = () => map.easeTo({ bearing: 0 });
$('zoom-in').onclick = () => map.zoomIn();
$('zoom-out').onclick = () => map.zoomOut();
$('theme').onclick = () => theme(theme() === 'dark' ? 'light' : 'dark');
$('layers').onclick = () => { const open = $('panel').hidden; $('panel').hidden = !open; $('layers').setAttribute('aria-expanded', String(open)); };
if (innerWidth < 700) $('layers').click();
for (const button of document.querySelectorAll('[data-ground]')) {
  button.onclick = () => {
    ground = button.dataset.ground;
    for (const other of document.querySelectorAll('[data-ground]')) other.setAttribute('aria-checked', String(other === button));
    applyLayers();
  };
}
for (const button of document.querySelectorAll('[data-layer]')) {
  button.onclick = () => {
    layers[button.dataset.layer] = pressed(button, !pressed(button));
    applyLayers();
  };
}
const EYE_SHARE = 0.3;  // of what is seen of the map across: how high above the ground the camera stands
const camera = new Camera($('camera-panel'), $('camera-picture'), $('camera-says'), {
  base: () => base,
  // Back from the middle of what the page shows, so that it is in the middle of the picture too.
  async place(pitch) {
    const { lat, lng } = map.getCenter().wrap();
    const ground = await getJson(`${base}height?lat=${lat.toFixed(8)}&lon=${lng.toFixed(8)}`).catch(() => null);
    const metres = (west, east) => new maplibregl.LngLat(west, lat).distanceTo(new maplibregl.LngLat(east, lat));
    const shown = map.getBounds();
    const whole = doc('elevation')?.bounds;
    const across = Math.min(metres(shown.getWest(), shown.getEast()), whole ? metres(whole[0], whole[2]) : Infinity);
    const [low, high] = doc('elevation')?.height_range ?? [0, 0];
    const above = Math.max(5, EYE_SHARE * across);
    const heading = (map.getBearing() + 360) % 360;
    const turn = heading * Math.PI / 180;
    const back = above / Math.tan(-pitch * Math.PI / 180);
    const degree = 111320;  // metres, of latitude
    return { lat: lat - back * Math.cos(turn) / degree, lon: lng - back * Math.sin(turn) / (degree * Math.cos(lat * Math.PI / 180)),
      height: Math.max(high, (ground?.height_m ?? low) + above), heading };
  },
});
$('camera').onclick = () => { const on = pressed($('camera'), !pressed($('camera'))); if (on) camera.open(); else camera.close(); };
$('camera-here').onclick = () => camera.stand();
$('camera-close').onclick = () => $('camera').click();
$('mission').onchange = async () => showMission($('mission').value, await loadMissions());
$('plan-file').onchange = async () => {
  const file = $('plan-file').files[0];
  if (!file) return;
  const answer = await fetch(`${base}plan`, { method: 'PUT', body: await file.text() });
  note(answer.ok ? 'The plan is in force' : (await answer.text()).trim());
  $('plan-file').value = '';
  refreshPlan();
};
$('plan-clear').onclick = async () => { await fetch(`${base}plan`, { method: 'DELETE' }); refreshPlan(); };
map.on('dragstart', () => pressed($('follow'), false));
map.on('rotate', () => { $('needle').style.transform = `rotate(${-map.getBearing()}deg)`; });
map.on('click', async (event) => {
  const { lat, lng } = event.lngLat.wrap();
  showHeight({ lat, lng }, await getJson(`${base}height?lat=${lat.toFixed(8)}&lon=${lng.toFixed(8)}`));
});
map.on('error', (event) => console.warn(event.error?.message ?? event));

loadMissions().then(loadInfo).then(loadTrack).then(refreshCoverage).catch(() => note('The server does not answer', 10)).finally(() => new Live(live));
window.overfly = { map, layers, area };  // for tests and the curious
