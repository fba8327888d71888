// The operator page: the link's own tiles on a map, and everything around it. All that it needs comes from
// this server. The map is MapLibre GL's where there is WebGL 2 and this build has it, else a flat one.
import { Accuracy } from './accuracy.js';
import { Camera } from './camera.js';
import { FlatMap } from './flat_map.js';
import { GlMap } from './gl_map.js';
import { Live } from './live.js';
import { Missions } from './missions.js';
import { area, firstTheme, note, openOne, pressed, showContact, showCoverage, showHeight, showLegend, showStatus, theme } from './panels.js';
import { OTHER_CAMERAS, Tiles } from './map_tiles.js';

const $ = (id) => document.getElementById(id);
const layers = { track: true, footprints: false, coverage: false, quality: false, plan: true };
const FOOTPRINTS = 400;  // shown at most, the newest
let ground = 'photo';
let mission = null;   // the one shown; null: the current one
let lastFrame = null;
let moved = false;      // somebody has chosen what to look at
let shownBounds = null;
let isLive = false;
let hasMission = true;
const track = { frames: [], last: null };
const tiles = new Tiles();
const accuracy = new Accuracy();
const missions = new Missions({ show: (id) => showMission(id) });

firstTheme();

// ---- the map ----

const events = {
  async tap(lat, lng) {
    showHeight({ lat, lng }, await getJson(`${tiles.base}height?lat=${lat.toFixed(8)}&lon=${lng.toFixed(8)}`));
  },
  grab() { pressed($('follow'), false); },
  turn(bearing) { $('needle').style.transform = `rotate(${-bearing}deg)`; },
};

// MapLibre GL is loaded where it can run: not every build has it, not every browser can.
async function makeView() {
  const wanted = !new URLSearchParams(location.search).has('flat');
  const probe = wanted ? document.createElement('canvas').getContext('webgl2') : null;
  probe?.getExtension('WEBGL_lose_context')?.loseContext();
  const able = Boolean(probe);
  const load = (tag, attributes) => new Promise((done) => {
    const element = Object.assign(document.createElement(tag), attributes);
    element.onload = () => done(true);
    element.onerror = () => done(false);
    document.head.prepend(element);  // the page's own sheet has the last word
  });
  if (able && await load('script', { src: 'maplibre-gl.js' })) {
    await load('link', { rel: 'stylesheet', href: 'maplibre-gl.css' });
    try {
      return new GlMap($('map'), tiles, events);
    } catch (problem) {
      console.warn(problem);
      $('map').replaceChildren();
    }
  }
  if (wanted) note(able ? 'This build has no 3-D map: the flat one is shown' : 'This browser has no WebGL 2: the flat map is shown', 6);
  return new FlatMap($('map'), tiles, events);
}

const view = await makeView();
$('tilt').hidden = $('north').hidden = !view.tilts;

const collection = (features) => ({ type: 'FeatureCollection', features });

// A map that grows a finer level is built anew.
let built = null;
function buildLayers() {
  const extent = tiles.extent;
  const signature = extent?.bounds ? `${mission}/${tiles.info.map}/${extent.minzoom}-${extent.maxzoom}-${['elevation', ...OTHER_CAMERAS].map((name) => Boolean(tiles.doc(name)?.bounds))}` : '';
  if (signature === built) return;
  const first = !built;
  built = signature;
  for (const name of OTHER_CAMERAS) {
    const button = document.querySelector(`[data-ground="${name}"]`);
    button.hidden = !tiles.doc(name)?.bounds;
    if (button.hidden && ground === name) document.querySelector('[data-ground="photo"]').click();
  }
  view.build();
  view.show(ground, layers);
  drawTrack();
  refreshPlan();
  if (view.tilts && pressed($('tilt'))) view.tilt(true);
  if (first) fit(false);
}

function applyLayers() {
  view.show(ground, layers);
  showLegend(layers);
}

function fit(smooth = true) {
  if (!tiles.bounds) return;
  view.fit(tiles.bounds, { top: 90, bottom: 100, left: innerWidth > 900 ? 60 : 20, right: 80 }, (tiles.doc('color')?.maxzoom ?? 20) + 1, smooth);
}

// ---- what changes ----

async function getJson(path) {
  const answer = await fetch(path, { cache: 'no-cache' });
  return answer.ok ? answer.json() : null;
}

// Several events within a moment are one look at the server.
function gather(action, pause) {
  let timer = null;
  return () => { timer ??= setTimeout(async () => { timer = null; await action().catch(() => {}); }, pause); };
}

// Where the map ended when a tile came, the tile was not asked for; it is, once the map's new bounds are known.
let beyond = [];
const refreshTiles = (changed) => { for (const [name, list] of Object.entries(tiles.changed(changed))) view.refresh(name, list); };

const refreshInfo = gather(loadInfo, 1500);
async function loadInfo() {
  const late = [...beyond];
  const next = await getJson(`${tiles.base}tiles.json`);
  if (!next) return;
  tiles.info = next;
  beyond = beyond.slice(late.length);
  await view.ready;
  buildLayers();
  const bounds = JSON.stringify(tiles.bounds ?? null);
  if (bounds === shownBounds || !tiles.bounds) return;
  refreshTiles(late);
  // The view grows with the map until somebody moves it.
  if (shownBounds && !moved && !pressed($('follow'))) fit();
  shownBounds = bounds;
}

const refreshTrack = gather(loadTrack, 1000);
async function loadTrack() {
  for (;;) {
    const answer = await getJson(`${tiles.base}track${track.last === null ? '' : `?after=${track.last}`}`);
    if (!answer) return;
    track.frames.push(...answer.frames);
    if (answer.frames.length) track.last = answer.frames.at(-1).id;
    if (!answer.more) break;
  }
  drawTrack();
}

function drawTrack() {
  const points = track.frames.filter((f) => f.lat !== undefined).map((f) => [f.lon, f.lat]);
  const line = (coordinates) => ({ type: 'Feature', properties: {}, geometry: { type: 'LineString', coordinates } });
  lastFrame = points.at(-1) ?? null;
  view.draw('track', collection(points.length > 1 ? [line(points)] : []));
  view.draw('drone', collection(lastFrame ? [{ type: 'Feature', properties: {}, geometry: { type: 'Point', coordinates: lastFrame } }] : []));
  view.draw('footprints', collection(track.frames.slice(-FOOTPRINTS).filter((f) => f.footprint).map((f) => line([...f.footprint, f.footprint[0]]))));
  if (pressed($('follow')) && lastFrame) view.go(...lastFrame);
}

const refreshCoverage = gather(async () => {
  const report = await getJson(`${tiles.base}coverage.json`);
  showCoverage(report);
  if (report) view.draw('gaps', report.gaps);
  view.refresh('coverage');
}, 2500);

async function refreshPlan() {
  view.draw('plan', await getJson(`${tiles.base}plan`).catch(() => null));
  refreshCoverage();
}

// False: the server does not answer.
async function loadMissions() {
  if (!await missions.load()) return false;
  missions.fill(mission);
  const shown = missions.find(mission);
  hasMission = Boolean(missions.current);
  isLive = Boolean(shown?.live);
  document.title = shown ? `${shown.name} · overfly` : 'overfly';
  return true;
}

async function showMission(id) {
  await loadMissions();
  const chosen = missions.find(id);
  mission = chosen && !chosen.current ? chosen.id : null;
  tiles.base = mission ? `m/${mission}/` : '';
  isLive = Boolean(chosen?.live);
  missions.fill(mission);
  document.title = chosen ? `${chosen.name} · overfly` : 'overfly';
  track.frames = [];
  track.last = null;
  built = null;
  moved = false;
  shownBounds = null;
  await loadInfo();
  await loadTrack();
}

let frameCount = -1;
const live = {
  change(changed) {
    if (mission !== null) return;
    refreshTiles(changed);
    beyond.push(...changed);
    refreshInfo();
    refreshTrack();
    refreshCoverage();
  },
  resync() {
    if (mission !== null) return;
    refreshInfo();
    refreshTrack();
    refreshCoverage();
    view.refreshAll();
  },
  async mission() {
    note('A new mission has begun');
    await showMission(null);
  },
  status(status) {
    const nowLive = mission === null && Boolean(status.mission?.live);
    if (mission === null && nowLive !== isLive) loadMissions();
    isLive = nowLive;
    showStatus(status);
    accuracy.update(status);
    const frames = status.map?.frames ?? 0;
    if (frames !== frameCount && mission === null) {
      frameCount = frames;
      refreshTrack();
      refreshCoverage();
      if (!tiles.info || !built) refreshInfo();
    }
  },
  // No stream: the server is away, or has nothing to tell of yet.
  async silent() {
    const had = hasMission;
    if (!await loadMissions()) return false;
    if (!had && hasMission) await showMission(null);
    return !hasMission;
  },
  contact(seconds) { showContact(seconds, isLive, hasMission); },
};

// ---- controls ----

$('fit').onclick = () => { moved = false; fit(); };
for (const kind of ['pointerdown', 'wheel', 'keydown']) $('map').addEventListener(kind, () => { moved = true; }, { capture: true, passive: true });
for (const id of ['zoom-in', 'zoom-out', 'follow']) $(id).addEventListener('click', () => { moved = true; });
$('follow').onclick = () => { const on = !pressed($('follow')); pressed($('follow'), on); if (on && lastFrame) view.go(...lastFrame); };
$('tilt').onclick = () => view.tilt(pressed($('tilt'), !pressed($('tilt'))));
$('north').onclick = () => view.northUp();
$('zoom-in').onclick = () => view.zoomBy(1);
$('zoom-out').onclick = () => view.zoomBy(-1);
$('theme').onclick = () => theme(theme() === 'dark' ? 'light' : 'dark');
$('layers').onclick = () => openOne('panel');
for (const id of ['lag', 'accuracy']) $(id).onclick = () => { openOne('accuracy-panel'); if (accuracy.open) accuracy.load(); };
$('mission').onclick = () => { openOne('mission-panel'); if (!$('mission-panel').hidden) loadMissions(); };
if (innerWidth < 700) openOne('panel');
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
  base: () => tiles.base,
  // Back from the middle of what the page shows, so that it is in the middle of the picture too.
  async place(pitch) {
    const { lat, lng } = view.centre;
    const below = await getJson(`${tiles.base}height?lat=${lat.toFixed(8)}&lon=${lng.toFixed(8)}`).catch(() => null);
    const degree = 111320;  // metres, of latitude
    const metres = (west, east) => (east - west + (east < west ? 360 : 0)) * degree * Math.cos(lat * Math.PI / 180);
    const whole = tiles.doc('elevation')?.bounds;
    const across = Math.min(metres(view.seen[0], view.seen[2]), whole ? metres(whole[0], whole[2]) : Infinity);
    const [low, high] = tiles.doc('elevation')?.height_range ?? [0, 0];
    const above = Math.max(5, EYE_SHARE * across);
    const heading = view.bearing;
    const turn = heading * Math.PI / 180;
    const back = above / Math.tan(-pitch * Math.PI / 180);
    return { lat: lat - back * Math.cos(turn) / degree, lon: lng - back * Math.sin(turn) / (degree * Math.cos(lat * Math.PI / 180)),
      height: Math.max(high, (below?.height_m ?? low) + above), heading };
  },
});
$('camera').onclick = () => { const on = pressed($('camera'), !pressed($('camera'))); if (on) camera.open(); else camera.close(); };
$('camera-here').onclick = () => camera.stand();
$('camera-close').onclick = () => $('camera').click();
$('plan-file').onchange = async () => {
  const file = $('plan-file').files[0];
  if (!file) return;
  const answer = await fetch(`${tiles.base}plan`, { method: 'PUT', body: await file.text() });
  note(answer.ok ? 'The plan is in force' : (await answer.text()).trim());
  $('plan-file').value = '';
  refreshPlan();
};
$('plan-clear').onclick = async () => { await fetch(`${tiles.base}plan`, { method: 'DELETE' }); refreshPlan(); };

loadMissions().then(loadInfo).then(loadTrack).then(refreshCoverage).catch(() => note('The server does not answer', 10)).finally(() => new Live(live));
window.overfly = { view, tiles, layers, area };  // for tests and the curious
