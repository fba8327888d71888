// What the server says is new: one event stream, reconnected by the browser, and its silence noticed.
export class Live {
  // on: {change(tiles), resync(), mission(), status(object), contact(seconds), silent()}; silent(), when there is
  // no stream to be had, promises whether the server answers all the same
  constructor(on) {
    this.on = on;
    this.last = performance.now();
    this.open();
    setInterval(() => on.contact((performance.now() - this.last) / 1000), 500);
  }

  open() {
    this.stream = new EventSource('events?status=1');
    const heard = (name, action) => this.stream.addEventListener(name, (event) => {
      this.last = performance.now();
      action(JSON.parse(event.data));
    });
    heard('hello', (hello) => {
      if (this.map && this.map !== hello.map) this.on.mission();
      this.map = hello.map;
    });
    heard('change', (change) => this.on.change(change.tiles));
    heard('resync', () => this.on.resync());
    heard('mission', (mission) => { this.map = mission.map; this.on.mission(); });
    heard('status', (status) => this.on.status(status));
    // a browser gives up for good on some errors; so do we not
    this.stream.onerror = () => {
      if (this.stream.readyState !== EventSource.CLOSED) return;
      setTimeout(async () => {
        if (await this.on.silent()) this.last = performance.now();
        this.open();
      }, 2000);
    };
  }
}
