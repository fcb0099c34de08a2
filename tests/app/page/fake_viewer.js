// Stands in for the Rerun viewer: the test says what it has drawn, and that it dies.
window.fake = {
  asked: [], // calls by which the page changes what it shows: their names, and what they were given
  serial: 1_000_000, // of the message that it took in last
  stores: [], // beside the run's own
  panicked: false,
  options: null, // that it was started with
  panels: {}, // their states
  pick: null, // hears of clicks in its views
};
const own = () => `Recording:ispom:${window.ispom.state.recording_id}`;
const called = (name, given) => void window.fake.asked.push([name, JSON.stringify(given)]);

export class WebViewer {
  on(event, callback) {
    if (event === "selection_change") window.fake.pick = callback;
  }
  async start(_, parent, options) {
    window.fake.options = options;
    this.canvas = parent.appendChild(document.createElement("canvas"));
    this.canvas.tabIndex = 0;
    this.canvas.addEventListener("keydown", (event) => event.preventDefault()); // as the viewer keeps all keys
  }
  get ready() {
    return !window.fake.panicked;
  }
  override_panel_state(panel, state) {
    window.fake.panels[panel] = state;
  }
  open_channel() {
    return { send_rrd() {}, close() {} };
  }
  get_active_recording_id() {
    return (window.fake.stores[0] ?? own()).split(":").at(-1);
  }
  get_time_range(recording) {
    return own().endsWith(`:${recording}`) ? { min: 0, max: window.fake.serial } : null;
  }
  async get_state() {
    return { recordings: [own(), ...window.fake.stores].map((store_id) => ({ store_id })) };
  }
  async get_blueprint() {
    return { blueprint: {} };
  }
  async set_blueprint(blueprint) {
    called("set_blueprint", blueprint);
  }
  async set_time(time) {
    called("set_time", time);
  }
  async close({ store_ids }) {
    called("close", store_ids);
    window.fake.stores = [];
  }
}
