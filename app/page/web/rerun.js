// The Rerun viewer in its canvas, and the two time cursors: ours sets Rerun's, and a hand on Rerun's timeline sets ours.
// Rerun tells of every change of its cursor, up to half a second late, and not who made it. A change is the person's only
// where a touch of the canvas is newer than all that we asked for, and the change is nothing that we asked for.
import { feedLive } from "./live.js";
import { wake } from "./render_throttle.js";
import { setTimeCursor, PAUSED, FOLLOWING } from "./viewer_control.js";

const TIMELINE = "exposure";
const HAND_MS = 3000; // how long after a touch of the canvas a change of time may be the person's
const HELD_MS = 500; // how long a press keeps our requests back
const SETTLE_MS = 60; // a hand that drags chooses that often
const LATE = 8; // requests whose answers may still come

export function openViewer(dark, seek) {
  const canvas = document.getElementById("canvas");
  const sync = { handle: null, wanted: null, sent: null, asked: [], busy: false, seen: null, timeline: null, run: 0, seek };
  forget(sync);
  for (const kind of ["pointerdown", "pointerup", "pointermove", "wheel", "keydown"]) {
    canvas.addEventListener(kind, (event) => touched(sync, event), { capture: true, passive: true });
  }
  // Not before there is something to show: starting takes seconds of processor time, which the first exposure needs.
  sync.start = () => {
    sync.start = () => {};
    start(canvas, dark, (event) => heard(sync, event)).then(
      (handle) => {
        sync.handle = handle;
        push(sync);
      },
      (fault) => failed(`The Rerun viewer did not start: ${fault.message ?? fault}. The controls at the left work without it.`),
    );
  };
  for (const kind of ["resize", "focus", "visibilitychange"]) addEventListener(kind, () => wake());
  return { follow: (state) => follow(sync, state), release: () => release(sync), sync };
}

async function start(canvas, dark, onEvent) {
  document.getElementById("loaded").hidden = false;
  await wasm_bindgen({ module_or_path: counted("/viewer/re_viewer_bg.wasm") });
  cover("Starting the Rerun viewer …");
  const handle = new wasm_bindgen.WebHandle({
    hide_welcome_screen: true,
    persist: false,
    theme: dark ? "dark" : "light",
    panel_state_overrides: { top: "Hidden", blueprint: "Hidden", selection: "Hidden", time: "Collapsed" },
    on_viewer_event: (text) => onEvent(JSON.parse(text)),
  });
  await handle.start(canvas);
  document.getElementById("cover").hidden = true;
  feedLive(handle);
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
  if (state.run !== sync.run) Object.assign(sync, { run: state.run, wanted: null, sent: null, asked: [] });
  if (state.index < 0) return;
  sync.start();
  if (sync.chosen !== null) return;
  const live = state.index >= state.computed - 1 && (state.playing || state.target !== null);
  sync.playing = state.playing;
  sync.wanted = live ? "following" : state.index;
  push(sync);
}

// One request at a time, and only the latest: an answer can take a quarter of a second in software rendering. Where a hand
// has just come down, Rerun is left alone: what it tells next is where the hand went.
async function push(sync) {
  if (!sync.handle || sync.busy) return;
  sync.busy = true;
  while (sync.wanted !== sync.sent) {
    const held = sync.pressedAt + HELD_MS - performance.now();
    if (held > 0) await wait(held);
    else await ask(sync, sync.wanted);
  }
  sync.busy = false;
}

async function ask(sync, wanted) {
  forget(sync);
  sync.asked = [...sync.asked, wanted].slice(-LATE);
  try {
    const live = wanted === "following";
    wake(!sync.playing); // otherwise somebody waits for the answer
    await sync.handle.viewer_control(setTimeCursor(TIMELINE, live ? null : wanted, live ? FOLLOWING : PAUSED));
    sync.sent = wanted;
  } catch {
    await wait(300); // no recording there yet: try again
  }
}

const wait = (ms) => new Promise((done) => setTimeout(done, ms));

function touched(sync, event) {
  wake(true);
  if (event.type === "pointermove" && !event.buttons) return;
  sync.touchedAt = performance.now();
  if (event.type === "pointerdown") sync.pressedAt = sync.touchedAt;
}

function forget(sync) {
  Object.assign(sync, { touchedAt: -Infinity, pressedAt: -Infinity, chosen: null });
}

// The person goes on elsewhere on the page: where the hand went is said first, and nothing later counts as the hand's.
function release(sync) {
  if (sync.chosen !== null) choose(sync);
  forget(sync);
}

// Rerun -> ours, when a person did it.
function heard(sync, event) {
  if (event.type === "timeline_change") sync.timeline = event.timeline;
  if (event.type !== "time_update" || sync.timeline !== TIMELINE) return;
  wake();
  const before = sync.seen;
  const index = (sync.seen = Math.round(event.time));
  const streamed = sync.sent === "following" && index >= before;
  if (answers(sync, index) || streamed || index === sync.sent) return;
  if (performance.now() - sync.touchedAt > HAND_MS) return;
  if (sync.chosen === null) setTimeout(() => sync.chosen !== null && choose(sync), SETTLE_MS);
  sync.chosen = sync.sent = sync.wanted = index;
}

function choose(sync) {
  const index = sync.chosen;
  sync.chosen = null;
  sync.seek(index);
}

// Whether we asked for this; what was asked for before it is answered as well. Where Rerun was asked to follow its stream,
// it goes wherever that is.
function answers(sync, index) {
  const at = sync.asked.findIndex((wanted) => wanted === index || wanted === "following");
  sync.asked.splice(0, at + 1);
  return at >= 0;
}
