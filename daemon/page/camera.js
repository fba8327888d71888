// The view drawn on board (/preview.jpg): dragging turns it, the wheel narrows it. One picture is asked for at
// a time, always the latest one wanted.
const WIDTH = 640, HEIGHT = 360;
const PITCH = -35;  // degrees, at first
const SHARPER = 4000;  // ms between pictures while nobody turns it: the map goes on

export class Camera {
  // `place(pitch)`: a promise of {lat, lon, height, heading} to stand at. `base`: '' or 'm/ID/'.
  constructor(panel, picture, says, { place, base }) {
    Object.assign(this, { panel, picture, says, place, base });
    this.view = null;
    this.wanted = false;
    this.busy = false;
    picture.addEventListener('pointerdown', (event) => picture.setPointerCapture(event.pointerId));
    picture.addEventListener('pointermove', (event) => {
      if (!event.buttons || !this.view) return;
      const degrees = this.view.fov / picture.clientWidth;  // the ground follows the finger
      this.view.heading = (this.view.heading - event.movementX * degrees + 360) % 360;
      this.view.pitch = Math.max(-90, Math.min(60, this.view.pitch + event.movementY * degrees));
      this.ask();
    });
    picture.addEventListener('wheel', (event) => {
      event.preventDefault();
      if (!this.view) return;
      this.view.fov = Math.max(5, Math.min(120, this.view.fov * 1.1 ** Math.sign(event.deltaY)));
      this.ask();
    }, { passive: false });
  }

  async open() {
    this.panel.hidden = false;
    await this.stand();
    this.timer = setInterval(() => this.ask(), SHARPER);
  }

  close() {
    this.panel.hidden = true;
    clearInterval(this.timer);
  }

  async stand() {
    this.view = { pitch: PITCH, fov: 60, ...await this.place(PITCH) };
    await this.ask();
  }

  async ask() {
    this.wanted = true;
    if (this.busy) return;
    this.busy = true;
    while (this.wanted && !this.panel.hidden && this.view) {
      this.wanted = false;
      const { lat, lon, height, heading, pitch, fov } = this.view;
      const query = new URLSearchParams({ lat: lat.toFixed(8), lon: lon.toFixed(8), height: height.toFixed(2),
        heading: heading.toFixed(2), pitch: pitch.toFixed(2), fov: fov.toFixed(1), w: WIDTH, h: HEIGHT });
      const answer = await fetch(`${this.base()}preview.jpg?${query}`, { cache: 'no-store' }).catch(() => null);
      if (answer?.ok) {
        const old = this.picture.src;
        this.picture.src = URL.createObjectURL(await answer.blob());
        await this.picture.decode().catch(() => {});
        if (old.startsWith('blob:')) URL.revokeObjectURL(old);
        this.says.textContent = `${Math.round(heading)}\u00b0, ${Math.round(pitch)}\u00b0 \u00b7 ${height.toFixed(0)} m \u00b7 drag to look around`;
      } else {
        this.says.textContent = answer ? (await answer.text()).trim() : 'no contact';
        if (answer?.status === 501) break;  // nothing is drawn here, however often one asks
        await new Promise((done) => setTimeout(done, 400));
        if (answer?.status === 503) this.wanted = true;
      }
    }
    this.busy = false;
  }
}
