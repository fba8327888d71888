// The missions' panel: which there are, showing one, starting and ending where the server lets one.
import { note } from './panels.js';

const $ = (id) => document.getElementById(id);
const CERTAIN = 4000;  // ms within which a second tap ends a mission

const text = (tag, words) => { const out = document.createElement(tag); out.textContent = words; return out; };
const date = (ms) => ms ? new Date(ms).toLocaleString([], { dateStyle: 'medium', timeStyle: 'short' }) : '';

export class Missions {
  list = [];
  changeable = false;

  // `show(id)`: the page is to show another one.
  constructor({ show }) {
    this.show = show;
    $('mission-new').onsubmit = (event) => { event.preventDefault(); this.start(); };
    $('mission-end').onclick = () => this.end();
  }

  // Null: the server does not answer.
  async load() {
    const answer = await fetch('missions', { cache: 'no-cache' }).then((got) => got.ok ? got.json() : null).catch(() => null);
    if (!answer) return null;
    this.list = answer.missions;
    this.changeable = Boolean(answer.changeable);
    return this.list;
  }

  get current() { return this.list.find((mission) => mission.current); }
  find(id) { return this.list.find((mission) => mission.id === id) ?? this.current; }

  // `shown`: id of the one that the page shows; null: the current one.
  fill(shown) {
    const selected = this.find(shown);
    $('mission-name').textContent = selected?.name ?? 'no mission yet';
    $('mission-list').replaceChildren(...[...this.list].reverse().map((mission) => {
      const row = document.createElement('button');
      row.dataset.mission = mission.id;
      row.setAttribute('role', 'radio');
      row.setAttribute('aria-checked', String(mission === selected));
      row.append(text('b', mission.name), text('small', [mission.live ? 'live' : '', date(mission.started_utc_ms)].filter(Boolean).join(' · ')));
      row.onclick = () => this.show(mission.id);
      return row;
    }));
    const live = this.list.some((mission) => mission.live);
    $('mission-new').hidden = !this.changeable || live;
    $('mission-end').hidden = !this.changeable || !live;
    this.sure(false);
  }

  sure(asked) {
    clearTimeout(this.timer);
    this.asked = asked;
    $('mission-end').textContent = asked ? 'Tap again: no more frames' : 'End the mission';
    $('mission-end').classList.toggle('sure', asked);
    if (asked) this.timer = setTimeout(() => this.sure(false), CERTAIN);
  }

  async change(method, body) {
    const answer = await fetch('missions', { method, body }).catch(() => null);
    if (!answer?.ok) note(answer ? (await answer.text()).trim() : 'no contact', 8);
    return answer?.ok ? answer : null;
  }
  async start() {
    const answer = await this.change('POST', JSON.stringify({ name: $('mission-called').value.trim() }));
    if (!answer) return;
    $('mission-called').value = '';
    const { id, name } = await answer.json();
    note(`Mission ${name} takes frames`);
    this.show(id);
  }
  async end() {
    if (!this.asked) { this.sure(true); return; }
    this.sure(false);
    if (!await this.change('DELETE')) return;
    note('The mission takes no more frames; its map is finished');
    this.show(null);
  }
}
