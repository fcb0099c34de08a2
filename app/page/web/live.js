// The run's stream: `.rrd` bytes from the server, as fast as the viewer takes them in. The server names the run first, in a
// text; then it sends as many binary messages as were asked for, each with the number of the next item at its head. Another
// run is another channel.
import { fed } from "./render_throttle.js";

const AHEAD = 3; // messages asked for beyond the one that the viewer is taking in
const RETRY_MS = 1000;
const HEAD_BYTES = 4;

export function feedLive(handle) {
  let run = "";
  let next = 0;

  function connect() {
    const url = new URL(`live?run=${run}&next=${next}`, document.baseURI);
    const socket = new WebSocket(url.href.replace("http", "ws"));
    const more = () => socket.readyState === WebSocket.OPEN && socket.send("more");
    socket.binaryType = "arraybuffer";
    socket.onopen = () => Array.from({ length: AHEAD }, more);
    socket.onmessage = async ({ data }) => {
      if (typeof data === "string") begin(data);
      else {
        next = new DataView(data).getUint32(0);
        handle.send_rrd_to_channel(run, new Uint8Array(data, HEAD_BYTES));
        await fed(data.byteLength);
        more();
      }
    };
    socket.onclose = () => setTimeout(whenSeen, RETRY_MS);
  }

  function begin(name) {
    if (run) handle.close_channel(run);
    run = name;
    handle.open_channel(run, "run");
  }

  function whenSeen() {
    if (document.visibilityState === "visible") connect();
    else document.addEventListener("visibilitychange", whenSeen, { once: true });
  }

  connect();
}
