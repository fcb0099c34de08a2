// The page's address names what is shown: `#run=sim:city&branch=1&at=214&select=track:stereo:181&hidden=clouds`. One that somebody opens or
// changes is followed, a step with each state: the run, its branch, the layers, what is looked at, the exposure.
const WRITE_MS = 500; // browsers refuse more than some 7 changes a second
const STEPS = [
  ["run", (state, run) => state.address.run === run, (run) => ({ do: "open_named", run })],
  ["branch", (state, branch) => state.address.branch === Number(branch), (branch) => ({ do: "show_branch", number: Number(branch) })],
  ["hidden", (state, hidden) => String(state.address.hidden) === hidden, (hidden) => ({ do: "hide", names: hidden ? hidden.split(",") : [] })],
  ["select", (state, what) => state.selected === what, (what) => ({ do: "select", what })],
  ["at", (state, at) => state.index === Number(at), (at) => ({ do: "seek", index: Number(at) })],
];

export function makeAddress(send) {
  let wanted = read(); // what is still to be reached; null while the address follows the page
  let asked = null; // the step that was asked for, and the notices that there were then
  let writtenAt = 0;
  let due = null;
  const write = (state) => {
    due = null;
    writtenAt = performance.now();
    const { run, branch, hidden } = state.address;
    const found = new URLSearchParams({ run, ...(branch && { branch }), at: state.index, ...(hidden.length && { hidden }), ...(state.selected && { select: state.selected }) });
    const hash = `#${String(found).replaceAll("%3A", ":").replaceAll("%2C", ",")}`;
    if (hash !== location.hash) history.replaceState(null, "", hash);
  };
  addEventListener("hashchange", () => {
    asked = null;
    wanted = read();
    if (wanted && shown) follow(shown);
  });
  let shown = null;
  const follow = (state) => {
    shown = state;
    if (state.phase === "opening" || state.index < 0) return;
    if (wanted) reach(state);
    if (wanted) return;
    clearTimeout(due);
    due = setTimeout(() => write(state), Math.max(0, writtenAt + WRITE_MS - performance.now()));
  };
  const reach = (state) => {
    const notices = state.notices.at(-1)?.number ?? 0;
    const step = STEPS.find(([name, reached]) => wanted[name] !== undefined && !reached(state, wanted[name]));
    if (!step) wanted = null;
    else if (asked?.name !== step[0]) {
      asked = { name: step[0], notices };
      send(step[2](wanted[step[0]]));
    } else if (state.notices.some(({ kind, number }) => kind === "error" && number > asked.notices)) wanted = null; // refused
  };
  return { follow };
}

// The parts of the address; null where it names nothing.
function read() {
  const found = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  return found.run === undefined && found.at === undefined ? null : { hidden: "", branch: "0", select: "", ...found };
}
