// The run's stream: `.rrd` bytes from the server, as fast as the viewer takes them in. The server names the run first, in a
// text; then it sends as many binary messages as were asked for, each with the number of the next item at its head. Another
// run is another channel.
import { fed } from "./render_throttle.js";

const AHEAD = 3; // messages asked for beyond the one that the viewer is taking in
const RETRY_MS = 1000;
const FULL_BYTES = 250e6; // of memory, beyond which the viewer is given time to give up its oldest exposures:
const FRAMES_TO_FORGET = 8; // so many frames for each in which it takes in something. It forgets for 3.5 ms a frame
const HEAD_BYTES = 4;

// `heap` gives the bytes of memory that the viewer has taken so far; it never gives any back.
export function feedLive(handle, heap) {
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
        await fed(data.byteLength, heap() > FULL_BYTES ? FRAMES_TO_FORGET : 1);
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
