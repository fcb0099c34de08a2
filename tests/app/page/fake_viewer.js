// Stands in for the Rerun viewer: the test says what it has drawn, and that it dies.
window.fake = {
  asked: [], // messages to its control API
  serial: 1_000_000, // of the message that it took in last
  stores: [], // beside the run's own
  panicked: false,
  options: null, // that it was started with
};
{
  const varint = (value) => (value > 127 ? [(value % 128) | 128, ...varint(Math.floor(value / 128))] : [value]);
  const number = (tag, value) => [...varint(tag << 3), ...varint(value)];
  const bytes = (tag, content) => [...varint((tag << 3) | 2), ...varint(content.length), ...content];
  const text = (tag, value) => bytes(tag, [...new TextEncoder().encode(value)]);
  const recording = (store) =>
    bytes(3, [
      ...text(1, store),
      ...bytes(2, [...bytes(1, text(1, "stage")), ...bytes(3, [...number(1, 0), ...number(2, window.fake.serial)])]),
    ]);

  window.wasm_bindgen = Object.assign(async () => ({ memory: { buffer: new ArrayBuffer(8) } }), {
    WebHandle: class {
      constructor(options) {
        window.fake.options = options;
      }
      async start(canvas) {
        canvas.tabIndex = 0;
        canvas.addEventListener("keydown", (event) => event.preventDefault()); // as the viewer keeps all keys
      }
      open_channel() {}
      close_channel() {}
      send_rrd_to_channel() {}
      async viewer_control(message) {
        const kind = message[0] >> 3;
        window.fake.asked.push([kind, new TextDecoder().decode(message)]);
        if (kind === 1) window.fake.stores = [];
      }
      viewer_state() {
        const own = `Recording:ispom:${window.ispom.state.recording_id}`;
        return Uint8Array.from([own, ...window.fake.stores].flatMap(recording));
      }
      has_panicked() {
        return window.fake.panicked;
      }
      panic_message() {
        return "out of memory\nat wasm";
      }
    },
  });
}
