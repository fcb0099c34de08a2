// The page's address names what is shown: `#run=sim:city&branch=1&at=214&select=track:stereo:181&hidden=clouds`. One that
// somebody opens or changes is followed, a step with each state: run, branch, layers, what is looked at and plotted, frame.
// Of a lesson it names that and the step alone: `#lesson=collapse:2`. The page's own mode, which nobody else sees, stands behind: `&mode=learn`.
const WRITE_MS = 500; // browsers refuse more than some 7 changes a second
const PATIENCE_MS = 8000; // for a part that the run does not have, such as a frame beyond its end
const DEFAULTS = { lesson: "", branch: "0", hidden: "", layers: "", select: "", plot: "" }; // what need not be written
const STEPS = [
  step(
    "lesson",
    (state) => state.address.lesson,
    (lesson) => (lesson ? learn(lesson) : { do: "end_lesson" }),
  ),
  step(
    "run",
    (state) => state.address.run,
    (run) => ({ do: "open_named", name: run }),
  ),
  step(
    "branch",
    (state) => state.address.branch,
    (branch) => ({ do: "show_branch", number: Number(branch) }),
  ),
  step(
    "hidden",
    (state) => state.address.hidden,
    (hidden) => ({ do: "hide", names: hidden ? hidden.split(",") : [] }),
  ),
  step(
    "layers",
    (state) => state.address.layers,
    (layers) => ({ do: "choose", names: layers ? layers.split(",") : [] }),
  ),
  step(
    "select",
    (state) => state.selected,
    (what) => ({ do: "select", what }),
  ),
  step(
    "plot",
    (state) => state.address.plots,
    (names) => ({ do: "set_plots", names: plotted(names) }),
  ),
  step(
    "at",
    (state) => state.index,
    (at) => ({ do: "seek", index: Number(at) }),
  ),
];

// A part of the address: how the state has it, and what is to be asked where that differs.
function step(name, shown, ask) {
  return { name, shown, ask };
}

// `drives` says whether this page may change all that; one that follows another's may look at a frame of its own.
// `modes` has the page's mode, and the one that it opens in.
export function makeAddress(send, drives, modes) {
  let wanted = read(late.instead(location.hash)); // what is still to be reached; null while the address follows the page
  if (wanted && played.before()) delete wanted.at; // a run that plays goes on: its address is behind it
  let since = performance.now(); // when that was read
  let asked = null; // the step that was asked for, and the notices that there were then
  let driving = false; // whether this page drove when it last looked
  let writtenAt = 0;
  let written = location.hash; // as this page left it; else somebody has changed it, which is heard of a moment later
  let due = null;
  const write = (state) => {
    due = null;
    late.forget();
    if (location.hash !== written) return;
    writtenAt = performance.now();
    const hash = hashOf(state, modes);
    if (hash !== written) history.replaceState(null, "", hash);
    written = location.hash;
  };
  modes.set(modeIn(location.hash) ?? modes.usual);
  addEventListener("hashchange", () => {
    modes.set(modeIn(location.hash) ?? modes.usual);
    asked = null;
    wanted = read(location.hash);
    since = performance.now();
    written = location.hash;
    if (wanted && shown) follow(shown);
  });
  // What is written while the page is left goes with it: it stays due.
  addEventListener("beforeunload", () => {
    if (due === null) return;
    clearTimeout(due);
    due = setTimeout(() => write(shown), 2 * WRITE_MS);
    writtenAt = performance.now() + WRITE_MS;
  });
  let shown = null;
  const follow = (state) => {
    if (state.playing !== shown?.playing) played.keep(state.playing);
    shown = state;
    if (state.phase !== "empty" && (state.phase === "opening" || state.index < 0)) return;
    if (wanted && !reached(state)) return;
    clearTimeout(due);
    late.keep(written, hashOf(state, modes));
    due = setTimeout(() => write(state), Math.max(0, writtenAt + WRITE_MS - performance.now()));
  };
  // Whether there is nothing more to ask for; where there is, it is asked for, which may come back here at once.
  const reached = (state) => {
    if (driving !== drives()) [driving, asked] = [!driving, null];
    const notices = state.notices.at(-1)?.number ?? 0;
    const steps = driving ? STEPS : STEPS.filter(({ name }) => name === "at");
    const next = steps.find(({ name, shown }) => wanted[name] !== undefined && String(shown(state)) !== wanted[name]);
    const waited = asked && performance.now() - asked.at >= PATIENCE_MS;
    if (!next || (asked?.name === next.name && (refused(state, asked) || (waited && idle(state))))) {
      // A page that comes after one which the server has yet to see closed follows at first, and drives a moment later.
      if (driving || performance.now() - since >= PATIENCE_MS) wanted = null;
      return true;
    }
    if (asked?.name !== next.name) {
      asked = { name: next.name, notices, at: performance.now() };
      setTimeout(() => shown && follow(shown), PATIENCE_MS);
      send(next.ask(wanted[next.name]));
    }
    return false;
  };
  return { follow, release: () => (wanted = null) }; // who goes on by hand has other wishes
}

const refused = (state, asked) => state.notices.some(({ kind, number }) => kind === "error" && number > asked.notices);
const idle = (state) => state.target === null && !state.activity && !state.question;

// What is shown, as an address names it.
function hashOf(state, { mode, usual }) {
  const named = state.phase === "empty" ? [] : state.address.lesson ? STEPS.slice(0, 1) : STEPS;
  const parts = [...named.map(({ name, shown }) => [name, String(shown(state))]), ["mode", mode]];
  const defaults = { ...DEFAULTS, mode: usual };
  const found = new URLSearchParams(parts.filter(([name, value]) => value !== defaults[name]));
  return `#${String(found).replaceAll("%3A", ":").replaceAll("%2C", ",")}`;
}

// The address that is due to be written: a reload before that goes by it. It is none of a tab whose address was changed since.
const late = {
  keep: (written, hash) => hash === written || stored((session) => session.setItem("address", JSON.stringify([written, hash]))),
  forget: () => stored((session) => session.removeItem("address")),
  instead: (hash) => {
    const [written, due] = JSON.parse(stored((session) => session.getItem("address")) ?? "[]");
    return written === hash ? due : hash;
  },
};

// Whether the run played when this page was left to be loaded again.
const played = {
  keep: (playing) => stored((session) => session.setItem("playing", playing)),
  before: () =>
    performance.getEntriesByType("navigation")[0]?.type === "reload" && stored((session) => session.getItem("playing")) === "true",
};

// A browser may forbid to keep anything.
function stored(ask) {
  try {
    return ask(sessionStorage);
  } catch {
    return null;
  }
}

const modeIn = (hash) => new URLSearchParams(hash.slice(1)).get("mode");

// The parts of an address; null where it names nothing.
function read(hash) {
  const found = Object.fromEntries(new URLSearchParams(hash.slice(1)));
  if (found.lesson) return { lesson: found.lesson };
  return found.run === undefined && found.at === undefined ? null : { ...DEFAULTS, ...found };
}

// "collapse:2" is the second step of a lesson, "collapse" its first that was not answered yet.
function learn(lesson) {
  const [name, step] = lesson.split(":");
  return { do: "learn", name, place: step ? Number(step) - 1 : null };
}

// The usual plots for "", and none for "none".
function plotted(names) {
  if (!names) return null;
  return names === "none" ? [] : names.split(",");
}
