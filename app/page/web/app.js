// The page: talks to the session over one WebSocket, shows its state, and keeps the two viewers on the same exposure.
import { makeAddress } from "./address.js";
import { makeAxis } from "./time_axis.js";
import { openControls } from "./controls.js";
import { listen, setKeys } from "./keyboard.js";
import { showNotices } from "./notices.js";
import { makePlot } from "./plot.js";
import { openViewer } from "./rerun.js";
import { openSaving } from "./save_view.js";
import { makeSplitter } from "./splitter.js";
import { showOffline, showState, showViewer } from "./status_bar.js";

history.replaceState(null, "", location.pathname + location.hash); // the token is the cookie's now, and nobody's to copy

const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => location.reload());

let socket;
let state = null;
const pane = { wide: false, tab: "" };
const send = (message) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));
const viewer = openViewer(dark.matches, (index) => send({ do: "seek", index }), showViewer);

function paneBecame(change) {
  if (Object.entries(change).every(([key, value]) => pane[key] === value)) return;
  send({ do: "pane", ...Object.assign(pane, change) });
}
makeSplitter((wide) => paneBecame({ wide }));

function connect() {
  socket = new WebSocket(new URL("ws", document.baseURI).href.replace("http", "ws"));
  socket.onopen = () => send({ do: "pane", ...pane });
  socket.onmessage = ({ data }) => {
    state = JSON.parse(data);
    if (state.keys) setKeys(state.keys);
    window.ispom = { state, viewer, send, axis: axis.data };
    showState(state);
    axis.show(state);
    showPlot(state.plot);
    showNotices(state.notices);
    viewer.follow(state);
    address.follow(state);
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

function command(message) {
  viewer.release();
  address.release();
  send(message);
}
listen(window, command);
openControls(dark.matches, command, (tab) => paneBecame({ tab }));

const address = makeAddress(send);
const showPlot = makePlot(command);
openSaving();
const axis = makeAxis((index) => command({ do: "seek", index }));

connect();
