// The session of a published page: the states that the server would send, from data that was computed when the run was
// published (app/features/publish/messages.py). It does what only looks, and refuses what needs an estimator.
import { load } from "./published.js";
import { commandsOf } from "./published_moves.js";

const REFUSAL = "This is a published run: it plays, and computes nothing. Open the folder of the run with ispom app to do that.";
const SILENT = new Set(["pane", "pick", "pick_on_stage", "select", "follow", "take_control", "show_branch", "choose"]);

// As openSocket of session_link.js.
export function openPublished({ opened, heard, lost }) {
  const session = { data: null, state: null };
  const chunks = new Map(); // what the left pane says, by number of its file
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
    tell(change.plots ? { plots: plotNews(data, change.plots) } : {});
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
