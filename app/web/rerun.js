// The Rerun viewer in its canvas, and the two time cursors: ours sets Rerun's, and a hand on Rerun's timeline sets ours.
import { setTimeCursor, PAUSED, FOLLOWING } from "./viewer_control.js";

const TIMELINE = "exposure";
const HAND_MS = 500; // how long after a touch of the canvas a change of time counts as the person's

export function openViewer(dark, seek) {
  const canvas = document.getElementById("canvas");
  const sync = { handle: null, wanted: null, sent: null, busy: false, touched: -HAND_MS, seen: null, following: null, run: 0 };
  for (const kind of ["pointerdown", "pointerup", "wheel", "keydown"]) {
    canvas.addEventListener(kind, () => (sync.touched = performance.now()), { capture: true, passive: true });
  }
  canvas.addEventListener("pointermove", (e) => e.buttons && (sync.touched = performance.now()), { passive: true });
  start(canvas, dark, (event) => heard(sync, event, seek)).then(
    (handle) => {
      sync.handle = handle;
      push(sync);
    },
    (fault) => failed(`The Rerun viewer did not start: ${fault.message ?? fault}. The controls at the left work without it.`),
  );
  return { follow: (state) => follow(sync, state), sync };
}

async function start(canvas, dark, onEvent) {
  await wasm_bindgen({ module_or_path: counted("/viewer/re_viewer_bg.wasm") });
  cover("Starting the Rerun viewer …");
  const scheme = location.protocol === "https:" ? "rerun+https" : "rerun+http";
  const handle = new wasm_bindgen.WebHandle({
    url: [`${scheme}://${location.host}/proxy`],
    hide_welcome_screen: true,
    persist: false,
    theme: dark ? "dark" : "light",
    panel_state_overrides: { top: "Hidden", blueprint: "Hidden", selection: "Hidden", time: "Collapsed" },
    on_viewer_event: (text) => onEvent(JSON.parse(text)),
  });
  await handle.start(canvas);
  document.getElementById("cover").hidden = true;
  return handle;
}

// The WebAssembly, with a bar that shows how much of it is there.
async function counted(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(await response.text());
  const total = Number(response.headers.get("Content-Length"));
  let loaded = 0;
  const count = new TransformStream({
    transform(chunk, out) {
      loaded += chunk.byteLength;
      document.getElementById("loaded").value = total ? loaded / total : 0;
      cover(`Loading the Rerun viewer: ${(loaded / 1e6).toFixed(0)} of ${(total / 1e6).toFixed(0)} MB`);
      out.enqueue(chunk);
    },
  });
  return new Response(response.body.pipeThrough(count), { headers: { "Content-Type": "application/wasm" } });
}

function failed(text) {
  cover(text);
  document.getElementById("loaded").hidden = true;
}

const cover = (text) => (document.getElementById("loading").textContent = text);

// Our state -> Rerun: at the newest exposure Rerun follows its stream, in the past it stands at the exposure shown.
function follow(sync, state) {
  if (state.run !== sync.run) Object.assign(sync, { run: state.run, sent: null });
  if (state.index < 0) return;
  const newest = state.index >= state.head - 1;
  sync.following = newest && (state.playing || state.target !== null);
  sync.wanted = sync.following ? "following" : state.index;
  push(sync);
}

// One request at a time, and only the latest: an answer can take a quarter of a second in software rendering.
async function push(sync) {
  if (!sync.handle || sync.busy || sync.wanted === null || sync.wanted === sync.sent) return;
  sync.busy = true;
  const wanted = sync.wanted;
  try {
    const request = wanted === "following" ? setTimeCursor(TIMELINE, null, FOLLOWING) : setTimeCursor(TIMELINE, wanted, PAUSED);
    await sync.handle.viewer_control(request);
    sync.sent = wanted;
  } catch {
    await new Promise((done) => setTimeout(done, 300)); // no recording there yet: try again
  }
  sync.busy = false;
  push(sync);
}

// Rerun -> ours, when a person did it.
function heard(sync, event, seek) {
  if (event.type !== "time_update") return;
  sync.seen = event.time;
  const byHand = performance.now() - sync.touched < HAND_MS;
  const index = Math.round(event.time);
  if (!byHand || index === sync.sent) return;
  sync.sent = sync.wanted = index;
  clearTimeout(sync.timer);
  sync.timer = setTimeout(() => seek(index), 60);
}
