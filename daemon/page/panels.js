// The controls and meters around the map. Knows the page, not MapLibre.
const $ = (id) => document.getElementById(id);

export function pressed(button, value) {
  if (value !== undefined) button.setAttribute('aria-pressed', String(value));
  return button.getAttribute('aria-pressed') === 'true';
}

export function note(text, seconds = 4) {
  const box = $('note');
  box.textContent = text;
  box.hidden = false;
  clearTimeout(note.timer);
  note.timer = setTimeout(() => { box.hidden = true; }, seconds * 1000);
}

const short = (n) => n === undefined ? '–' : n < 10000 ? String(n) : n < 1e6 ? `${(n / 1e3).toFixed(1)}k` : `${(n / 1e6).toFixed(1)}M`;

export function showStatus(status) {
  // what came since the daemon's start, or what the map has from before
  $('frames').textContent = short(Math.max(status.frames?.seen ?? 0, status.map?.frames ?? 0));
  $('tiles').textContent = short(status.map?.tiles);
  const lag = status.lag_s;
  const known = typeof lag === 'number';
  $('lag').querySelector('b').textContent = known ? `${lag < 10 ? lag.toFixed(1) : Math.round(lag)} s` : '–';
  const gauge = $('lag').querySelector('i');
  gauge.style.height = known ? `${Math.max(6, Math.min(100, 100 * Math.log10(1 + lag) / Math.log10(61)))}%` : '0';
  gauge.style.background = `var(--${lag < 5 ? 'good' : lag < 20 ? 'fair' : 'bad'})`;
}

export function showContact(seconds, live, hasMission) {
  const state = $('state');
  const say = (is, text) => { state.dataset.is = is; state.querySelector('span').textContent = text; };
  if (seconds > 4) say('lost', `no contact for ${Math.round(seconds)} s`);
  else if (!hasMission) say('none', 'ready for a mission');
  else if (live) say('live', 'mapping live');
  else say('done', 'finished map');
}

export function showCoverage(report) {
  const planned = report?.planned;
  $('cover').textContent = !report || !report.area_m2 ? '–' : planned ? `${report.covered_percent.toFixed(0)} %` : area(report.area_m2);
  $('cover-label').textContent = planned ? `of plan, ${report.min_views}+ views` : 'seen';
}

export function area(m2) {
  return m2 < 10000 ? `${Math.round(m2)} m²` : m2 < 1e6 ? `${(m2 / 1e4).toFixed(1)} ha` : `${(m2 / 1e6).toFixed(2)} km²`;
}

export function showHeight(at, answer) {
  $('place').textContent = `${at.lat.toFixed(6)}, ${at.lng.toFixed(6)}`;
  if (!answer) { $('height').textContent = 'no height here'; return; }
  const datum = answer.datum.startsWith('geoid') ? 'above sea level' : answer.datum === 'home' ? 'above home' : answer.datum === 'ellipsoid' ? 'above ellipsoid' : 'datum unknown';
  $('height').textContent = `${answer.height_m.toFixed(2)} m ± ${answer.accuracy_m.toFixed(2)}`;
  $('place').textContent += ` · ${datum}`;
}

export function showLegend(layers) {
  const parts = [];
  if (layers.coverage) {
    parts.push('<div>' + [['#d64541', '1 view'], ['#eb9532', '2'], ['#f4d03f', '3'], ['#3fb069', '4 and more']]
      .map(([colour, text]) => `<span><i style="background:${colour}"></i>${text}</span>`).join('') + '</div>');
  }
  if (layers.quality) parts.push('<div>uncertain <span class="ramp"></span> certain</div>');
  $('legend').innerHTML = parts.join('');
  $('legend').hidden = parts.length === 0;
}

// Opens a panel in the place of any other, or closes it.
export function openOne(id) {
  const opens = $(id).hidden;
  for (const button of document.querySelectorAll('[aria-controls]')) {
    const panel = button.getAttribute('aria-controls');
    $(panel).hidden = panel !== id || !opens;
    button.setAttribute('aria-expanded', String(!$(panel).hidden));
  }
}

export function theme(next) {
  const root = document.documentElement;
  if (next) {
    root.dataset.theme = next;
    try { localStorage.setItem('overfly-theme', next); } catch { /* private window */ }
  }
  return root.dataset.theme;
}

export function firstTheme() {
  let kept = null;
  try { kept = localStorage.getItem('overfly-theme'); } catch { /* private window */ }
  theme(kept ?? (matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark'));
}
