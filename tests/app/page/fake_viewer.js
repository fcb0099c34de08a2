// Stands in for the Rerun viewer: the test says what its cursor does, and when.
window.fake = { asked: [], tell: null };
async function wasm_bindgen() {}
wasm_bindgen.WebHandle = class {
  constructor(options) {
    window.fake.tell = (time) => options.on_viewer_event(JSON.stringify({ type: "time_update", time }));
    this.announce = () => options.on_viewer_event(JSON.stringify({ type: "timeline_change", timeline: "exposure", time: 0 }));
  }
  async start() {
    this.announce();
  }
  open_channel() {}
  close_channel() {}
  send_rrd_to_channel() {}
  async viewer_control(bytes) {
    window.fake.asked.push([...bytes]);
  }
};
