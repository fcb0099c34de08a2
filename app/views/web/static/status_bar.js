// The status bar: source, methods, what is going on, and where the run is.
import { following, wordsOf } from "./activity.js";
import { imagesUpTo, lateness } from "./frame_words.js";

const at = (id) => document.getElementById(id);
let activity = following(null, null, null, 0);

export function showState(state) {
  at("name").textContent = state.name;
  at("name").title = [state.source, ...state.notes].join("\n");
  showOrigin(state.origin);
  at("guess").hidden = state.guess === null;
  at("guess").textContent = `camera not calibrated: focal length ± ${state.guess} %`;
  at("guess").title = state.notes.join("\n");
  document.title = `${state.playing ? "▶ " : ""}${state.name} · ISPOM`;
  document.body.dataset.phase = state.phase;
  document.body.dataset.playing = state.playing;
  at("exposure").textContent = state.total ? `frame ${state.index < 0 ? "–" : state.index} / ${state.total - 1}` : "";
  at("time").textContent = state.total ? `${state.time_s.toFixed(2)} s` : "";
  at("methods").replaceChildren(...state.methods.map(method));
  at("methods").classList.toggle("many", state.methods.length > 3);
  const waiting = state.activity?.startsWith("Compiling"); // the run waits for it, and says so itself
  at("compiling").textContent = waiting ? "" : (state.compiling ?? "");
  showRecording(state.recording);
  activity = following(activity, doing(state), state.activity_since, performance.now());
  showActivity();
}

// What the Rerun views show, where that is not what the page shows: `shown` is their frame, null before this run's first;
// `coming` the one that they are taking in, and `other` says what they still show of another run. Null where they are gone.
export function showViewer(views) {
  const late = views ? lateness(views) : "";
  if (at("behind").textContent !== late) at("behind").textContent = late;
  const label = late || (views?.playing && views.shown ? `frame ${views.shown.index}` : "");
  if (at("shown").textContent !== label) at("shown").textContent = label;
  at("shown").hidden = !label;
  // While it plays, the views are always some frames behind: their label says so, and they do not fade.
  const behind = views?.playing ? "behind" : "late";
  at("viewer").dataset.views = views?.other === "source" ? "other" : late ? behind : "current";
}

// How many images there were up to the frame shown, beside its number.
export function showImages(kinds, index) {
  const text = imagesUpTo(kinds, index);
  if (at("images").textContent !== text) at("images").textContent = text;
}

export function showOffline(text = "connection to ISPOM lost: is it still running?") {
  activity = following(null, text, null, -Infinity);
  showActivity();
}

const doing = (state) => {
  if (state.target !== null) return `computing up to frame ${state.target}: ${state.computed} done`;
  if (state.activity) return `${state.activity} …`;
  return null;
};

function showActivity() {
  const text = wordsOf(activity, performance.now());
  if (at("activity").textContent !== text) at("activity").textContent = text; // a new text node is a new picture of the page
}
setInterval(showActivity, 250);

function method({ label, colour, status, word, severity, error, hint }) {
  const item = document.createElement("span");
  item.className = `method ${status} ${severity}`;
  item.style.setProperty("--colour", colour);
  item.title = hint;
  item.append(document.createElement("i"), part("b", label), part("span", word, "state"));
  if (error) item.append(part("span", error, "error"));
  return item;
}

function part(tag, text, kind = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  element.className = kind;
  return element;
}

// Whether the frame shown was computed here by now, of a run that began with recorded frames.
function showOrigin(origin) {
  at("origin").hidden = !origin;
  at("origin").classList.toggle("live", origin === "live");
  if (at("origin").textContent !== (origin ?? "")) at("origin").textContent = origin ?? "";
  at("origin").title =
    origin === "recorded"
      ? "This frame comes with ISPOM, and was recorded in an earlier run with the same settings. This computer is computing the run as well, and its frames take over."
      : "This frame was computed here.";
}

function showRecording(recording) {
  at("recording").hidden = !recording;
  if (recording)
    at("recording").lastElementChild.textContent = `${recording.closing ? "closing" : "REC"} ${recording.name} ${recording.size}`;
}
