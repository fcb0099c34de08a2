// The status bar and the notices.
const at = (id) => document.getElementById(id);
const SLOW_MS = 700;
let told = null;
let activity = { text: null, since: 0 };

export function showState(state) {
  at("name").textContent = state.name;
  at("name").title = [state.source, ...state.notes].join("\n");
  document.title = `${state.playing ? "▶ " : ""}${state.name} · ISPOM`;
  document.body.dataset.phase = state.phase;
  document.body.dataset.playing = state.playing;
  at("exposure").textContent = state.total ? `${Math.max(state.index + 1, 0)} / ${state.total}` : "";
  at("time").textContent = state.total ? `${state.time_s.toFixed(2)} s` : "";
  at("computed").style.width = `${(100 * state.computed) / Math.max(state.total, 1)}%`;
  at("cursor").style.left = `${(100 * Math.max(state.index, 0)) / Math.max(state.total - 1, 1)}%`;
  at("lamps").replaceChildren(...state.methods.map(lamp));
  showRecording(state.recording);
  showNotices(state.notices);
  activity = { text: doing(state), since: state.activity === activity.raw ? activity.since : performance.now(), raw: state.activity };
  showActivity();
}

export function showOffline() {
  activity = { text: "no connection to ISPOM: is it still running?", since: -SLOW_MS };
  showActivity();
}

const doing = (state) => {
  if (state.phase === "failed") return "nothing is open: choose a source at the left";
  if (state.target !== null) return `computing up to exposure ${state.target + 1}: ${state.computed} done`;
  if (state.activity) return `${state.activity} …`;
  return null;
};

function showActivity() {
  const waited = performance.now() - activity.since;
  const shown = activity.text && (waited >= SLOW_MS || activity.text.startsWith("computing"));
  const seconds = waited > 2000 && activity.raw ? ` ${Math.round(waited / 1000)} s` : "";
  const text = shown ? activity.text + seconds : "";
  if (at("activity").textContent !== text) at("activity").textContent = text; // a new text node is a new picture of the page
}
setInterval(showActivity, 250);

function lamp({ name, colour, status, error_m }) {
  const item = document.createElement("span");
  item.className = `lamp ${status ?? "waiting"}`;
  item.style.setProperty("--colour", colour);
  item.title = `${name}: ${status ?? "no exposure yet"}${error_m === null ? "" : `, ${metres(error_m)} from the truth`}`;
  item.append(document.createElement("i"), part("b", name.replaceAll("_", " ")), part("span", status ?? "waiting", "state"));
  item.append(part("span", error_m === null ? "" : metres(error_m), "error"));
  return item;
}

function part(tag, text, kind = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  element.className = kind;
  return element;
}

const metres = (m) => (m < 0.1 ? `${(1000 * m).toFixed(0)} mm` : `${m.toFixed(m < 10 ? 2 : 1)} m`);
export const megabytes = (bytes) => (bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);

function showRecording(recording) {
  at("recording").hidden = !recording;
  if (!recording) return;
  const closing = recording.closing ? "closing " : "REC ";
  at("recording").lastElementChild.textContent = `${closing}${recording.name} ${megabytes(recording.size_bytes)}`;
}

// A page that was just opened shows the newest error only; later ones all.
function showNotices(notices) {
  const last = notices.at(-1)?.number ?? 0;
  const fresh = told === null ? notices.slice(-1).filter((n) => n.kind === "error") : notices.filter((n) => n.number > told);
  told = last;
  for (const { text, kind } of fresh) {
    const item = document.createElement("div");
    item.className = `notice ${kind}`;
    const close = part("button", "✕");
    close.ariaLabel = "close";
    close.onclick = () => item.remove();
    item.append(part("span", text), close);
    at("notices").append(item);
    if (kind !== "error") setTimeout(() => item.remove(), 6000);
    while (at("notices").children.length > 4) at("notices").firstElementChild.remove();
  }
}
