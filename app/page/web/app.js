// The page: talks to the session over one WebSocket, shows its state, and keeps the two viewers on the same exposure.
import { showState, showOffline } from "./status_bar.js";
import { openViewer } from "./rerun.js";
import { makeSplitter } from "./splitter.js";

const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => location.reload());
document.getElementById("controls").src = `/viser/${dark.matches ? "?darkMode" : ""}`;

let socket;
let state = null;
let wide = false;
const send = (message) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));
const viewer = openViewer(dark.matches, (index) => send({ do: "seek", index }));

makeSplitter((now) => {
  if (now !== wide) send({ do: "pane", wide: (wide = now) });
});

function connect() {
  socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/ws`);
  socket.onopen = () => send({ do: "pane", wide });
  socket.onmessage = ({ data }) => {
    state = JSON.parse(data);
    window.ispom = { state, viewer, send };
    showState(state);
    viewer.follow(state);
  };
  socket.onclose = () => {
    showOffline();
    setTimeout(reconnect, 1000);
  };
}

// A failed WebSocket is an error in the console, a failed fetch as well: so few tries, and only while someone looks.
function reconnect() {
  if (document.visibilityState === "visible") connect();
  else document.addEventListener("visibilitychange", connect, { once: true });
}

// The same keys everywhere: viser has them as its commands, Rerun's canvas and the bar get them here.
const KEYS = { " ": { do: "play" }, ArrowRight: { do: "step", by: 1 }, ArrowLeft: { do: "step", by: -1 } };
addEventListener("keydown", (event) => {
  const typing = event.target instanceof HTMLInputElement && document.activeElement === event.target && event.target.value;
  const command = KEYS[event.key];
  if (!command || typing || event.target.id === "splitter" || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  viewer.release();
  send(command);
}, { capture: true });

document.getElementById("track").addEventListener("click", (event) => {
  viewer.release();
  if (state?.total) send({ do: "seek", index: Math.round((event.clientX / innerWidth) * (state.total - 1)) });
});

connect();
