// The accuracy panel: at which point of the front of accuracy against time the map is being made, how far it
// lags, and what waits to be made better. /front tells the points, the status events what changes.
const $ = (id) => document.getElementById(id);
const SVG = 'http://www.w3.org/2000/svg';
const BOX = { width: 356, height: 196, left: 40, right: 14, top: 12, bottom: 38 };  // of the plot
const AGAIN = 15000;  // ms after which the device's times are asked for again

const ms = (seconds) => { const value = 1000 * seconds; return value < 10 ? value.toFixed(1) : Math.round(value).toString(); };
const duration = (seconds) => seconds < 10 ? `${seconds.toFixed(1)} s` : seconds < 120 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
const plural = (count, what) => `${count} ${what}${count === 1 ? '' : 's'}`;

function part(name, attributes, words) {
  const out = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) out.setAttribute(key, value);
  if (words !== undefined) out.textContent = words;
  return out;
}

export class Accuracy {
  status = null;
  front = null;
  picked = null;  // index of a point that was tapped

  get open() { return !$('accuracy-panel').hidden; }

  // From a status event.
  update(status) {
    const quality = status.quality ?? null;
    const moved = quality?.index !== this.status?.quality?.index;
    this.status = status;
    $('accuracy').hidden = $('lag').disabled = !quality;
    if (!quality) return;
    $('accuracy').querySelector('b').textContent = quality.points ? `${quality.index} / ${quality.points}` : '–';
    if (!this.open) return;
    this.say();
    if (moved || !this.front || performance.now() - this.loaded > AGAIN) this.load();
  }

  async load() {
    this.loaded = performance.now();
    const answer = await fetch('front', { cache: 'no-cache' }).catch(() => null);
    if (!answer?.ok) return;
    this.front = await answer.json();
    this.say();
    this.plot();
  }

  say() {
    const quality = this.status?.quality;
    if (!quality) return;
    const point = this.front?.points[this.picked ?? quality.index - 1];
    const gsd = this.status.survey?.gsd_m ?? 0;
    const aim = this.front?.aim_s;
    $('accuracy-mode').textContent = `${quality.mode}: ${aim ? `tiles within ${duration(aim)}` : 'accuracy at any delay'}`;
    const other = this.picked !== null && this.picked !== quality.index - 1;
    const rows = [
      [other ? 'Point tapped' : 'Made at', point ? `${this.picked === null ? quality.index : this.picked + 1} of ${quality.points}: ${point.name}` : quality.point || '–'],
      ['Expected error', point ? `± ${point.nmad_gsd.toFixed(2)} texels${gsd ? ` (${(100 * gsd * point.nmad_gsd).toFixed(1)} cm)` : ''}, ${(100 * point.complete).toFixed(1)} % with a height` : '–'],
      ['Time per tile', point?.cell_s ? `${ms(point.cell_s)} ms here` : 'not measured here yet'],
      ['Lag', duration(this.status.lag_s ?? 0)],
      ['Waiting', this.status.tiles?.waiting_cells ? `${plural(this.status.tiles.waiting_cells, 'tile')}, ${duration(quality.backlog_s)} of work` : 'nothing'],
      ['To be improved', quality.to_improve ? `${plural(quality.to_improve, 'tile')} made at a faster point` : 'nothing'],
    ];
    if (quality.throttled) rows.push(['Heat', `${Math.round(100 * quality.headroom)} % of the speed: ${quality.throttled}`]);
    $('accuracy-facts').replaceChildren(...rows.flatMap(([name, value]) => {
      const key = document.createElement('dt'), what = document.createElement('dd');
      key.textContent = name;
      what.textContent = value;
      return [key, what];
    }));
  }

  plot() {
    const points = this.front.points, current = this.front.index - 1;
    const measured = points.every((point) => point.cell_s > 0);
    const time = (point) => measured ? 1000 * point.cell_s : 100 * point.relative_time;
    const times = points.map(time), errors = points.map((point) => point.error_gsd);
    const low = Math.min(...times) / 1.15, high = Math.max(...times) * 1.15, most = 1.08 * Math.max(...errors);
    const { width, height, left, right, top, bottom } = BOX;
    const x = (value) => left + (width - left - right) * Math.log(value / low) / Math.log(high / low);
    const y = (value) => height - bottom - (height - top - bottom) * value / most;
    const out = [];
    const step = [0.1, 0.2, 0.5, 1, 2, 5].find((one) => most / one <= 5) ?? 10;
    for (let value = 0; value <= most; value += step) {
      out.push(part('line', { class: 'grid', x1: left, x2: width - right, y1: y(value), y2: y(value) }));
      out.push(part('text', { x: left - 6, y: y(value) + 4, 'text-anchor': 'end' }, Number(value.toFixed(1))));
    }
    const few = high / low > 30 ? [1] : high / low > 6 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 7];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); ++power) {
      for (const factor of few) {
        const value = factor * 10 ** power;
        if (value < low || value > high) continue;
        out.push(part('line', { class: 'grid', x1: x(value), x2: x(value), y1: top, y2: height - bottom }));
        out.push(part('text', { x: x(value), y: height - bottom + 15, 'text-anchor': 'middle' }, Number(value.toPrecision(2))));
      }
    }
    out.push(part('text', { x: (left + width - right) / 2, y: height - 4, 'text-anchor': 'middle' }, measured ? 'ms per tile on this device' : 'time, % of the slowest point'));
    out.push(part('text', { x: -(top + height - bottom) / 2, y: 11, 'text-anchor': 'middle', transform: 'rotate(-90)' }, 'error, texels'));
    const order = points.map((_, i) => i).sort((a, b) => times[a] - times[b]);
    out.push(part('polyline', { class: 'front', points: order.map((i) => `${x(times[i])},${y(errors[i])}`).join(' ') }));
    points.forEach((point, i) => {
      const now = i === current;
      if (now) out.push(part('circle', { class: 'halo', cx: x(times[i]), cy: y(errors[i]), r: 12 }));
      const dot = part('circle', { class: now ? 'point now' : i === this.picked ? 'point picked' : 'point', 'data-point': i, cx: x(times[i]), cy: y(errors[i]), r: now ? 6.5 : 4.5 });
      dot.append(part('title', {}, point.name));
      out.push(dot);
    });
    const svg = $('accuracy-plot');
    svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
    svg.replaceChildren(...out);
    // a finger means the nearest point; the present one again ends it
    svg.onclick = (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const far = points.map((_, i) => Math.hypot(x(times[i]) - at.x, y(errors[i]) - at.y));
      const nearest = far.indexOf(Math.min(...far));
      this.picked = nearest === current || nearest === this.picked ? null : nearest;
      this.say();
      this.plot();
    };
  }
}
