// What the commands that only look mean in a published run: the fields of the state that take new values, or a sentence
// that says why there is nothing to do. As app/views/web/looking.py does it for a page that looks around by itself.
const MOST_PLOTS = 12;
const ONLY_FIRST = "This page has the comparisons of its first run with each of the others: choose the first one as A.";
const ALARMING = ["warning", "lost"];

export const commandsOf = {
  play: ({ on = null }, state, data) => {
    const playing = on ?? !state.playing;
    const last = Math.min(state.loop?.[1] ?? Infinity, data.frames.length - 1);
    return { playing, index: playing && state.index >= last ? (state.loop?.[0] ?? 0) : state.index };
  },
  step_by: ({ count }, state, data) => show(state.index + count, data),
  seek: ({ index }, _, data) => show(index, data),
  go_to_end: (_, __, data) => show(data.frames.length - 1, data),
  step_to: ({ kind, forwards = true }, state, data) => {
    const found = kind === "stereo" ? stereoFrames(data) : keyFrames(data);
    const index = nearest(found, state.index, forwards);
    const what = kind === "stereo" ? "stereo frame" : "keyframe";
    return index === undefined ? `there is no ${what} ${forwards ? "after" : "before"} frame ${state.index}` : show(index, data);
  },
  step_to_event: ({ forwards = true, alarming = false }, state, data) => {
    const events = [...(data.axis.events ?? []), ...(data.axis.marks?.bookmarks?.marks ?? []).map(({ at }) => ({ at, severity: "" }))];
    const frames = events.filter(({ severity }) => !alarming || ALARMING.includes(severity)).map(({ at }) => at);
    const index = nearest(frames, state.index, forwards);
    const what = alarming ? "anomaly" : "event";
    return index === undefined ? `No ${what} ${forwards ? "after" : "before"} frame ${state.index}.` : show(index, data);
  },
  speed: ({ factor }) => ({ speed: factor }),
  no_loop: () => ({ loop: null }),
  // An edge on the wrong side of the other one begins another loop.
  loop_edge: ({ edge }, { index, loop }, { frames }) => {
    const [before, after] = loop ?? [0, null];
    const [start, end] = edge === "start" ? [index, after > index ? after : null] : [before < index ? before : 0, index];
    return start < (end ?? frames.length - 1) ? { loop: [start, end] } : `a loop needs two frames: frame ${index} cannot be its ${edge}`;
  },
  set_loop: ({ start, end = null }, _, { frames }) => {
    const last = Math.min(end ?? Infinity, frames.length - 1);
    return start < last
      ? { loop: [Math.max(start, 0), end === null ? null : last] }
      : `a loop needs two frames: it cannot go from frame ${start} to ${last}`;
  },
  hide: ({ names }, _, data) => ({ hidden: names.filter((name) => data.paths[name]) }),
  plot: ({ name }, { plots }, data) => {
    if (plots.includes(name)) return { plots: plots.filter((each) => each !== name) };
    if (!data.plots.rows[name]) return `“${name.slice(0, 60)}” is no quantity of this run: choose a check, or one of the list`;
    return { plots: [...plots, name].slice(-MOST_PLOTS) };
  },
  set_plots: ({ names }, _, data) => ({ plots: (names ?? data.plots.usual).filter((name) => data.plots.rows[name]).slice(0, MOST_PLOTS) }),
  compare_runs: ({ a, b }, { compared }, { comparisons }) => {
    const found = comparisons.find(({ branches, numbers }) => branches[numbers[0]] === a && branches[numbers[1]] === b);
    return found ? { compared: [found.numbers[0], found.numbers[1], ...compared.slice(2)] } : ONLY_FIRST;
  },
  open_named: ({ name }, { source }) => (name === source ? {} : `this page has the run ${source}, and no other`),
};

const show = (index, { frames }) => ({ index: Math.min(Math.max(index, 0), frames.length - 1), playing: false });

const stereoFrames = ({ axis: { kinds } }) => [...kinds].flatMap((kind, i) => (kind === "s" ? [i] : []));
const keyFrames = ({ axis: { results } }) => results.flatMap(({ key_frames }) => key_frames);

function nearest(frames, index, forwards) {
  const found = frames.filter((frame) => (forwards ? frame > index : frame < index));
  if (found.length) return forwards ? Math.min(...found) : Math.max(...found);
}
