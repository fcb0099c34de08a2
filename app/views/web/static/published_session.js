// The session of a published page: the states that the server would send, from data that was computed when the run was
// published (app/features/publish/messages.py). It does what only looks, and refuses what needs an estimator.
import { load, site as many } from "./published.js";
import { makePublishedLessons } from "./published_lessons.js";
import { branchLayer, commandsOf, isBranch } from "./published_moves.js";

const REFUSAL = "This is a published run: it plays, and computes nothing. Open the folder of the run with ispom app to do that.";
const SILENT = new Set(["pane", "pick", "pick_on_stage", "select", "follow", "take_control", "show_branch", "choose"]);
const OPEN = "A question of the lesson is open: answer it and reveal the answer, or end the lesson first.";

// As openSocket of session_link.js.
export function openPublished({ opened, heard, lost }) {
  const session = { data: null, state: null, folder: null, site: null, runs: 0, asked: 0 };
  const lessons = makePublishedLessons(enter, () => tell());
  const chunks = new Map(); // what the left pane says, by name of its file
  async function open() {
    try {
      session.site = many ? await load("site") : null;
      const first = session.site?.first ?? "";
      take(first, await read(first));
    } catch (fault) {
      lost(`the data of this page cannot be loaded (${fault.message})`);
      return;
    }
    show(0, []);
    opened();
    tell(whole());
  }

  // The data of a run, from a folder of its own where there are many.
  async function read(folder) {
    if (folder === session.folder) return session.data;
    const data = await load(nameIn(folder, "run"));
    data.comparisons = data.runs.length > 1 ? await load("comparisons") : [];
    return data;
  }

  function take(folder, data) {
    if (folder !== session.folder) chunks.clear();
    Object.assign(session, { data, folder });
  }

  // A run at a frame or its last before it, as one that was just opened; null for what is shown already. Where another one is
  // asked for meanwhile, that is shown.
  async function enter(folder, index, hidden) {
    const own = ++session.asked;
    const wanted = folder ?? session.folder;
    const data = await read(wanted);
    if (own !== session.asked) return;
    take(wanted, data);
    show(index ?? session.state.index, hidden);
    tell(whole());
  }

  function show(index, hidden) {
    const { data } = session;
    const usual = { plots: data.plots.usual, loop: null, playing: false, refused: session.state?.refused ?? [0, ""], notices: [] };
    const last = Math.min(data.frames.length, lessons.view.limit) - 1;
    session.state = { ...data.message, ...usual, hidden, index: Math.min(index, last), run: ++session.runs };
  }

  // What comes to the page in increments.
  function whole() {
    const { data, state } = session;
    const { limit, covered } = lessons.view;
    const { stage } = data.frames[state.index];
    const axis = axisUntil(withoutBranches(data.axis, state.hidden), limit, covered);
    return { axis, plots: plotted(), stage: { ...data.eye, ...stage } };
  }

  // What is plotted now: nothing while a question covers it.
  function plotted() {
    const { data, state } = session;
    const { limit, covered } = lessons.view;
    return plotNews(data, covered ? [] : state.plots, limit, state.hidden);
  }

  // The state as the page is to show it now.
  function tell(news = {}) {
    const { data, state } = session;
    const { lesson, address: place, limit, covered } = lessons.view;
    const { plots, hidden, ...plain } = state;
    const usual = String(plots) === String(data.plots.usual);
    const layers = hidden.filter((name) => !isBranch(name)).sort();
    const address = { ...plain.address, hidden: layers, plots: usual ? "" : plots.join() || "none", lesson: place };
    const paths = [...new Set([...data.message.hidden, ...hidden.flatMap((name) => data.paths[name] ?? [])])];
    const own = { ...plain, ...data.frames[state.index], ...covered?.message, computed: Math.min(plain.computed, limit) };
    const waits = many === "lessons" && session.runs === 1; // nothing was chosen yet: the viewer need not start
    const recorded = waits ? null : { ...data.stage, file: nameIn(session.folder, "stage") };
    const learnt = session.site ? { lesson } : {};
    heard({ ...own, address, hidden: paths, axis: null, plots: null, recorded, ...pane(covered), ...learnt, ...news });
  }

  // What the left pane shows: the tabs, and the values of their views, those of the first frame until the file of this one has come.
  function pane(covered) {
    const { data, state, folder } = session;
    const { first, listed } = data.panels;
    const fixed = { fixed: data.panels, hidden: state.hidden };
    if (covered) return { panels: listed, views: covered.views, pane: fixed };
    const name = nameIn(folder, `panels-${Math.floor(state.index / data.panels.chunk)}`);
    if (!chunks.has(name)) {
      chunks.set(name, null);
      load(name).then(
        (chunk) => {
          if (!chunks.has(name)) return; // another run is shown by now
          chunks.set(name, chunk);
          tell();
        },
        () => chunks.delete(name),
      );
    }
    const frame = chunks.get(name)?.[state.index % data.panels.chunk] ?? {};
    const views = Object.fromEntries(Object.keys(first).map((name) => [name, { ...first[name], ...frame[name] }]));
    views.explain.plotted = state.plots;
    return { panels: listed, views, pane: fixed };
  }

  function send(message) {
    const { data, state, site } = session;
    if (!data || SILENT.has(message.do)) return;
    if (site && lessons.commands.has(message.do)) {
      lessons.obey(message, site).then(answered, (fault) => answered(`This cannot be loaded (${fault.message}).`));
      return;
    }
    const named = message.do === "open_named" && site?.listed.find(({ name, at }) => name === message.name && at !== undefined);
    if (named) {
      enter(named.name, named.at, []).catch((fault) => answered(`This cannot be loaded (${fault.message}).`));
      return;
    }
    const isRefused = lessons.view.covered && message.do !== "look_at";
    const change = isRefused ? OPEN : (commandsOf[message.do] ?? refuse)(message, state, data);
    Object.assign(state, typeof change === "string" ? { refused: [state.refused[0] + 1, change] } : change);
    tell(change.plots ? { plots: plotted() } : {});
  }

  // What became of something that took a while.
  function answered(refusal) {
    const { state } = session;
    if (!refusal) return;
    Object.assign(state, { refused: [state.refused[0] + 1, refusal] });
    tell();
  }

  const answers = {
    comparison: () => comparisonOf(session.state, session.data),
    numbers: () => load(nameIn(session.folder, "numbers")),
    runs: () => ({
      lessons: session.site.listed.map((each) => ({ ...each, done: Math.min(lessons.steps[each.name] ?? 0, each.steps ?? 0) })),
    }),
  };
  const answer = async (address) => answers[address]?.() ?? null;

  return { open, send, answer };
}

const nameIn = (folder, name) => (folder ? `${folder}/${name}` : name);

const refuse = () => REFUSAL;

const comparisonOf = ({ compared }, { comparisons }) => comparisons.find(({ numbers }) => numbers[1] === compared?.[1]) ?? null;

// Of what happened in a run, what happened in its first frames; while a question covers it, their number alone.
function axisUntil(axis, limit, covered) {
  const computed = Math.min(axis.computed, limit);
  if (covered) return { ...axis, computed, methods: [], results: [], events: [] };
  if (computed === axis.computed) return axis;
  const results = (axis.results ?? []).map(({ key_frames, lost }) => ({
    key_frames: key_frames.filter((frame) => frame < computed),
    lost: lost.filter(([first]) => first < computed).map(([first, last]) => [first, Math.min(last, computed - 1)]),
  }));
  return { ...axis, computed, results, events: (axis.events ?? []).filter(({ at }) => at < computed) };
}

// Branches are in the order of their numbers, from 1 on.
function withoutBranches(axis, hidden) {
  const { branches } = axis.marks ?? {};
  if (!branches) return axis;
  const marks = branches.marks.filter((_, i) => !hidden.includes(branchLayer(i + 1)));
  return { ...axis, marks: { ...axis.marks, branches: { ...branches, marks } } };
}

// The message that replaces all plots by these, with their values in the first frames, and without the branches that are hidden.
function plotNews({ plots: { choices, rows, values } }, names, limit, hidden) {
  const isShown = ({ id }) => !hidden.includes(branchLayer(id.split("/")[1]));
  const shown = names.flatMap((name) => (rows[name] ? [{ ...rows[name], curves: rows[name].curves.filter(isShown) }] : []));
  const curves = shown.flatMap((row) => row.curves).map(({ id }) => id);
  return {
    choices,
    plots: shown,
    values: [...new Set(curves)].filter((id) => values[id]).map((id) => [id, ...first(values[id], limit)]),
  };
}

function first([frames, values], limit) {
  const count = frames.findLastIndex((frame) => frame < limit) + 1;
  return [frames.slice(0, count), values.slice(0, count)];
}
