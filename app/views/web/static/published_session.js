// The session of a published page: the states that the server would send, from data that was computed when the run was
// published (app/features/publish/messages.py). It does what only looks, and refuses what needs an estimator.
import { load } from "./published.js";
import { commandsOf } from "./published_moves.js";

const MOST_HZ = 60; // frames a second of "as fast as possible"
const REFUSAL = "This is a published run: it plays, and computes nothing. Open the folder of the run with ispom app to do that.";
const SILENT = new Set(["pane", "pick", "pick_on_stage", "select", "follow", "take_control", "show_branch", "choose"]);

// As openSocket of session_link.js.
export function openPublished({ opened, heard, lost }) {
  const session = { data: null, state: null, began: null };
  const chunks = new Map(); // what the left pane says, by number of its file
  let timer = 0;

  async function open() {
    try {
      session.data = await load("run");
      session.data.comparisons = session.data.runs.length > 1 ? await load("comparisons") : [];
    } catch (fault) {
      lost(`the data of this page cannot be loaded (${fault.message})`);
      return;
    }
    const { data } = session;
    session.state = { ...data.message, plots: data.plots.usual, hidden: [], loop: null, playing: false, refused: [0, ""], notices: [] };
    session.data.hidden = data.message.hidden;
    opened();
    const { stage } = data.frames[session.state.index];
    tell({ axis: data.axis, plots: plotNews(data, session.state.plots), stage: { ...data.eye, ...stage } });
  }

  // The state as the page is to show it now.
  function tell(news = {}) {
    const { data, state } = session;
    const frame = data.frames[state.index];
    const { plots, hidden, ...plain } = state;
    const usual = String(plots) === String(data.plots.usual);
    const address = { ...plain.address, hidden: [...hidden].sort(), plots: usual ? "" : plots.join() || "none" };
    const paths = [...new Set([...data.hidden, ...hidden.flatMap((name) => data.paths[name] ?? [])])];
    heard({ ...plain, ...frame, address, hidden: paths, axis: null, plots: null, recorded: data.stage, ...pane(), ...news });
  }

  // What the left pane shows: the tabs, and the values of their views, those of the first frame until the file of this one has come.
  function pane() {
    const { data, state } = session;
    const number = Math.floor(state.index / data.panels.chunk);
    if (!chunks.has(number)) {
      chunks.set(number, null);
      load(`panels-${number}`).then(
        (chunk) => {
          chunks.set(number, chunk);
          tell();
        },
        () => chunks.delete(number),
      );
    }
    const { first, listed } = data.panels;
    const frame = chunks.get(number)?.[state.index % data.panels.chunk] ?? {};
    const views = Object.fromEntries(Object.keys(first).map((name) => [name, { ...first[name], ...frame[name] }]));
    views.explain.plotted = state.plots;
    return { panels: listed, views, pane: { fixed: data.panels, hidden: state.hidden } };
  }

  function send(message) {
    const { data, state } = session;
    if (!data || SILENT.has(message.do)) return;
    const change = (commandsOf[message.do] ?? refuse)(message, state, data);
    Object.assign(state, typeof change === "string" ? { refused: [state.refused[0] + 1, change] } : change);
    session.began = { at: performance.now(), index: state.index };
    clearTimeout(timer);
    if (state.playing) turn();
    tell(change.plots ? { plots: plotNews(data, change.plots) } : {});
  }

  // Goes on with the playback: the frame that is due now.
  function turn() {
    const { data, state, began } = session;
    const times = data.axis.times_ms;
    const first = state.loop?.[0] ?? 0;
    const last = Math.min(state.loop?.[1] ?? Infinity, data.frames.length - 1);
    const elapsed = performance.now() - began.at;
    let index = began.index;
    if (state.speed === null) index += Math.floor((elapsed * MOST_HZ) / 1000);
    else while (index < last && times[index + 1] - times[began.index] <= elapsed * state.speed) index++;
    if (index >= last) {
      if (state.loop && state.index >= last) index = first;
      else index = last;
      state.playing = Boolean(state.loop);
      session.began = { at: performance.now(), index };
    }
    const isNew = index !== state.index || !state.playing;
    state.index = index;
    if (state.playing) timer = setTimeout(turn, 1000 / MOST_HZ);
    if (isNew) tell();
  }

  const answer = async (address) => (address === "comparison" ? comparisonOf(session.state, session.data) : null);

  return { open, send, answer };
}

const refuse = () => REFUSAL;

const comparisonOf = ({ compared }, { comparisons }) => comparisons.find(({ numbers }) => numbers[1] === compared?.[1]) ?? null;

// The message that replaces all plots by these.
function plotNews({ plots: { choices, rows, values } }, names) {
  const shown = names.map((name) => rows[name]).filter(Boolean);
  const curves = shown.flatMap((row) => row.curves).map(({ id }) => id);
  return {
    choices,
    plots: shown,
    values: [...new Set(curves)].filter((id) => values[id]).map((id) => [id, ...values[id]]),
  };
}
