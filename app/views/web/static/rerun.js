// The Rerun viewer in its canvas: it is started when a source is open, kept to the run that is on the page, with the
// layers and the frame that the page shows, and watched: which frame its views show, and whether it still lives.
import { afterFrames } from "./frames.js";
import { feedLive } from "./live.js";
import { feedPublished } from "./published_stage.js";
import { published, unpacked } from "./published.js";
import { makeEye } from "./stage_view.js";
import "./random_uuid.js";
import { closeOthers, redraw, serialOf, showsAnother, updateBlueprint } from "./viewer_control.js";

const WATCH_MS = 250;
const APPLICATION = "ispom";
// Beyond it, the viewer discards what is far from its time, and nothing sends that again. It holds one frame (see live.js),
// and never comes near.
const MEMORY = "1500MB";
const REVEAL_MS = 3000;
const STILL_MS = 2000;
const PICTURE_MS = 15_000; // for a frame of the viewer: with software graphics one takes up to a second
const at = (id) => document.getElementById(id);

// `send` gives a message to the server; `pick` is given what a hand clicked in a view, `drawn` what the views show: see status_bar.js.
export function openViewer(send, pick, drawn) {
  const canvas = at("canvas");
  const viewer = { handle: null, stage: null, state: null, shown: null, source: null, hidden: null, drawn };
  viewer.eye = makeEye(canvas, (message) => control(viewer, message));
  const heard = (event) => picked(viewer, event, pick);
  // Not before the source is open: starting takes seconds of processor time. With the first frame would be too late:
  // that would be out of date when the viewer has started.
  viewer.start = () => {
    viewer.start = () => {};
    start(canvas, heard).then(
      (handle) => {
        viewer.handle = handle;
        viewer.stage = feed(viewer, send);
        setInterval(() => watch(viewer), WATCH_MS);
      },
      (fault) => say(`The Rerun viewer did not start: ${fault.message ?? fault}. The controls on the left work without it.`, true),
    );
  };
  at("restart").onclick = () => location.reload();
  viewer.follow = (state) => {
    viewer.state = state;
    viewer.eye.follow(state.stage);
    if (state.total && state.recorded !== null) viewer.start();
    if (viewer.handle) watch(viewer);
  };
  viewer.picture = () => pictureOf(viewer);
  viewer.connected = () => viewer.stage?.connected?.();
  viewer.streamed = (data) => viewer.stage?.streamed(data);
  return viewer;
}

// What the viewer shows comes from the server, or from the file of a published page.
function feed(viewer, send) {
  const news = () => watch(viewer);
  if (published) return feedPublished(viewer.handle, news, (message) => control(viewer, message));
  return feedLive(viewer.handle, send, news, () => keepStill(viewer));
}

async function start(canvas, onPick) {
  at("loaded").hidden = false;
  const { WebViewer } = await import(new URL("rerun/viewer.js", document.baseURI));
  const handle = new WebViewer();
  handle.on("selection_change", onPick);
  await handle.start(null, canvas.firstElementChild, {
    width: "100%",
    height: "100%",
    hide_welcome_screen: true,
    persist: false,
    memory_limit: MEMORY,
    theme: "system",
  });
  // The page has the time, and the only controls of it: two that disagree are worse than one.
  for (const panel of ["top", "blueprint", "selection", "time"]) handle.override_panel_state(panel, "hidden");
  return handle;
}

// The viewer's WebAssembly, for its own script (app/views/web/rerun_assets.py).
export async function wasm() {
  const found = await (published ? compressed("rerun/re_viewer_bg.wasm.bin") : counted("rerun/re_viewer_bg.wasm"));
  say("Starting the Rerun viewer …");
  return found;
}

// The WebAssembly, with a bar that shows how much of it is there.
async function counted(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(await response.text());
  const total = Number(response.headers.get("Content-Length"));
  let loaded = 0;
  const count = new TransformStream({
    transform(chunk, out) {
      showLoaded((loaded += chunk.byteLength), total);
      out.enqueue(chunk);
    },
  });
  return asWasm(response.body.pipeThrough(count));
}

const compressed = async (url) => asWasm(await unpacked(url, showLoaded));
const asWasm = (stream) => new Response(stream, { headers: { "Content-Type": "application/wasm" } });

function showLoaded(loaded, total) {
  at("loaded").value = total ? loaded / total : 0;
  say(`Loading the Rerun viewer: ${(loaded / 1e6).toFixed(0)} of ${(total / 1e6).toFixed(0)} MB`);
}

function say(text, ended = false) {
  at("cover").hidden = false;
  at("loading").textContent = text;
  at("loaded").hidden ||= ended;
  at("restart").hidden = !ended;
}

// A copy of what the viewer shows; null where it shows nothing, or draws nothing for so long.
async function pictureOf(viewer, patience = PICTURE_MS) {
  const { handle, shown, stage } = viewer;
  if (!handle?.ready || !at("cover").hidden) return null;
  const { canvas } = handle;
  return new Promise((done) => {
    setTimeout(done, patience, null);
    afterFrames(() => {
      const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
      const ink = copy.getContext("2d", { willReadFrequently: true });
      ink.drawImage(canvas, 0, 0);
      const drawn = ink.getImageData(copy.width >> 1, 0, 1, copy.height).data.some((value) => value); // a frame may be empty
      if (drawn) done(copy);
      return drawn;
    });
    control(viewer, stage.redraw?.() ?? redraw(shown));
  });
}

// While the viewer has something to take in, which it does as it draws, after each frame; otherwise now and then.
function watch(viewer) {
  bring(viewer);
  if (viewer.watchesFrames || viewer.died || !viewer.stage?.unread.length) return;
  viewer.watchesFrames = true;
  afterFrames(() => {
    viewer.watchesFrames = false;
    watch(viewer);
    return true;
  });
}

// Brings the viewer to what the page shows, wherever it is: its own shortcuts and menus may have moved it.
function bring(viewer) {
  const { handle, state, stage } = viewer;
  if (!stage || viewer.died) return;
  if (!handle.ready) return died(viewer);
  const id = `Recording:${APPLICATION}:${state.recording_id}`;
  if (state.index >= 0) stage.want(state.index, !state.playing || !viewer.source, state.recorded);
  stage.heard((recording) => serialOf(handle, recording));
  if (stage.fault) return say(stage.fault, true);
  const isShown = stage.shown?.recording === id && serialOf(handle, id) !== null;
  viewer.drawn({
    playing: state.playing,
    wanted: state.index,
    shown: isShown ? stage.shown : null,
    coming: stage.unread[0]?.index ?? stage.shown?.index,
    other: stage.shown && !isShown ? (viewer.source === state.source ? "branch" : "source") : null,
  });
  if (!viewer.source) at("viewer").classList.add("starting");
  if (!isShown) return;
  if (at("viewer").classList.contains("starting")) reveal(viewer);
  viewer.source = state.source;
  if (viewer.shown !== id || showsAnother(handle, id)) control(viewer, closeOthers(id));
  if (viewer.shown !== id) Object.assign(viewer, { shown: id, hidden: null });
  showLayers(viewer, id);
  viewer.eye.show(id);
}

// A click in a view: what it hit there, in the frame that the views show.
function picked({ stage }, { items }, pick) {
  const hit = items.find(({ type, position }) => type === "entity" && position);
  if (!hit || !stage?.shown) return;
  const position = [0, 1, 2].map((i) => hit.position[i] ?? null);
  pick({ do: "pick_on_stage", path: hit.entity_path, index: stage.shown.index, position, instance: hit.instance_id ?? null });
}

// The viewer takes in a little of the stream with each frame that it draws, and where graphics are software a frame takes
// long. Until it has a first frame it draws a tiny one: under the cover, or under a still picture of the run before.
async function keepStill(viewer) {
  const picture = at("viewer").classList.contains("starting") ? null : await pictureOf(viewer, STILL_MS);
  if (!picture) return;
  at("still").replaceChildren(picture);
  at("viewer").classList.add("starting");
}

// Lifts both with the next frame.
function reveal(viewer) {
  at("viewer").classList.remove("starting");
  const lift = () => {
    if (!viewer.died) at("cover").hidden = true;
    if (!at("viewer").classList.contains("starting")) at("still").replaceChildren();
    return true;
  };
  afterFrames(lift);
  setTimeout(lift, REVEAL_MS);
}

// The layers whose visibility changed, in the layout as it is: views, camera and time stay.
function showLayers(viewer, store) {
  const hidden = new Set(viewer.state.hidden);
  const changed = hidden.symmetricDifference(viewer.hidden ?? new Set());
  if (!changed.size) return;
  viewer.hidden = hidden;
  const visible = (path) => [path, { EntityBehavior: { visible: [!hidden.has(path)] } }];
  control(viewer, updateBlueprint(store, Object.fromEntries([...changed].map(visible))));
}

// False where the viewer refused.
async function control(viewer, order) {
  try {
    await order(viewer.handle);
    return true;
  } catch {
    return false;
  }
}

function died(viewer) {
  viewer.died = true;
  viewer.drawn(null);
  document.body.dataset.viewer = "died";
  say("The Rerun viewer stopped working. The run continues.", true);
}
