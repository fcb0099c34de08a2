// The time dock's rows over one time axis: what happened in the run, the plots, and the cursor. The server sends each frame
// once; pictures are drawn when something was added, while a run grows once in a while, and else only the cursor moves.
import { drawAxis, heightOf, laneAt, wordOf } from "./axis_picture.js";
import { makeLoopEdges } from "./loop_edges.js";
import { makePlots } from "./quantity_plots.js";
import { GUTTER, nearestFrame, PAD, placeOf } from "./time_scale.js";

const GROWS_MS = 1000; // between two pictures of a run that goes on: each costs as much as the whole run has marks
const NEAR_PX = 4; // an event so near to the pointer is named
const MOST_EVENTS = 4;
const at = (id) => document.getElementById(id);

export function makeAxis(seek, command) {
  const strip = at("axis");
  const plots = makePlots(at("plots"), command);
  const axis = {
    times: [],
    kinds: "",
    sensors: {}, // labels by the letters in kinds
    methods: [],
    computed: 0,
    marks: {}, // by kind: how they are drawn, and the frames that are marked
    events: [],
  };
  let index = -1;
  let width = strip.clientWidth;
  let due = null;
  const moveCursor = () => {
    const x = placeOf(axis.times, width, Math.max(index, 0));
    at("cursor").hidden = index < 0;
    at("cursor").style.left = `${x}px`;
    plots.moveTo(index);
  };
  let loop = null;
  const draw = () => {
    clearTimeout(due);
    due = null;
    strip.style.setProperty("--axis", `${heightOf(axis)}px`);
    drawAxis(strip.querySelector("canvas"), width, axis, (i) => placeOf(axis.times, width, i));
    plots.draw(axis, width);
    moveCursor();
    showLoop(loop, axis.times.length);
  };
  let asked = null;
  const frameAt = ({ clientX }) => nearestFrame(axis.times, width, clientX - strip.getBoundingClientRect().left);
  const showLoop = makeLoopEdges(
    at("rows"),
    frameAt,
    (frame) => placeOf(axis.times, width, frame),
    ([start, end]) => command({ do: "set_loop", start, end }),
  );
  const seekTo = (event) => {
    const wanted = frameAt(event);
    if (axis.times.length && wanted !== asked) seek((asked = wanted));
  };
  new ResizeObserver(() => {
    if (width === strip.clientWidth) return;
    width = strip.clientWidth;
    draw();
  }).observe(strip);
  strip.addEventListener("pointerdown", (event) => {
    const x = event.clientX - strip.getBoundingClientRect().left;
    if (x < GUTTER - 8 || x > width - PAD + 8) return; // the labels of the rows, or the values
    strip.setPointerCapture(event.pointerId);
    asked = null;
    seekTo(event);
  });
  strip.addEventListener("pointermove", (event) => {
    if (strip.hasPointerCapture(event.pointerId)) seekTo(event);
    hint(axis, plots, strip, event, frameAt(event));
  });
  strip.addEventListener("pointerleave", () => (at("axis-hint").hidden = true));

  return {
    data: axis,
    plots,
    show: (state) => {
      index = state.index;
      loop = state.loop;
      if (state.axis) take(axis, state.axis);
      if (state.plots) plots.take(state.plots);
      const { results, computed, ...rest } = state.axis ?? {};
      const { values, errors, ...newPlots } = state.plots ?? {};
      if ([rest, newPlots].some((news) => Object.keys(news).length)) draw();
      else if (results || values || errors) due ??= setTimeout(draw, GROWS_MS);
      moveCursor();
      showLoop(loop, axis.times.length);
    },
    draw,
  };
}

function take(axis, news) {
  if (news.methods) {
    const methods = news.methods.map((method) => ({ ...method, keyFrames: [], lost: [] }));
    Object.assign(axis, { times: [], kinds: "", sensors: news.sensors, methods, computed: 0, marks: {}, events: [] });
  }
  axis.times = axis.times.concat(news.times_ms ?? []);
  axis.kinds += news.kinds ?? "";
  axis.computed = news.computed ?? axis.computed;
  (news.results ?? []).forEach(({ key_frames, lost }, i) => {
    const method = axis.methods[i];
    method.keyFrames.push(...key_frames);
    for (const [first, last] of lost) {
      const before = method.lost.at(-1);
      if (before?.[1] === first - 1) before[1] = last;
      else method.lost.push([first, last]);
    }
  });
  axis.events.push(...(news.events ?? []));
  for (const [name, { more, ...kind }] of Object.entries(news.marks ?? {})) {
    if (more) axis.marks[name].marks.push(...kind.marks);
    else axis.marks[name] = kind;
  }
}

const near = (axis, width, index, x) => Math.abs(placeOf(axis.times, width, index) - x) <= NEAR_PX;

function hint(axis, plots, strip, { clientX, clientY, target }, index) {
  const box = at("axis-hint");
  const { left, top } = strip.getBoundingClientRect();
  const plot = target.closest?.(".plot")?.dataset.name;
  box.hidden = !axis.times.length || (plot !== undefined && (clientX - left < GUTTER || clientX - left > strip.clientWidth - PAD + 8));
  if (box.hidden) return;
  const lane = plot === undefined ? laneAt(axis, clientY - top + strip.scrollTop) : "";
  box.textContent = [
    lane,
    `frame ${index} · ${(axis.times[index] / 1000).toFixed(2)} s · ${wordOf(axis, axis.kinds[index])}`,
    index >= axis.computed ? "not computed yet" : "",
    ...(plot === undefined ? [] : plots.hintAt(plot, index)),
    ...axis.methods.map((method) => happened(method, index)),
    ...axis.events
      .filter((event) => near(axis, strip.clientWidth, event.at, clientX - left))
      .slice(0, MOST_EVENTS)
      .map(({ at, text }) => `${at}: ${text}`),
    ...Object.values(axis.marks).flatMap(({ marks }) => marks.filter(({ at }) => at === index).map(({ text }) => text)),
  ]
    .filter(Boolean)
    .join("\n");
  box.style.left = `${Math.min(Math.max(clientX - box.offsetWidth / 2, 4), innerWidth - box.offsetWidth - 4)}px`;
}

function happened({ label, keyFrames, lost }, index) {
  const what = [keyFrames.includes(index) && "keyframe", lost.some(([first, last]) => first <= index && index <= last) && "lost"];
  return what.some(Boolean) ? `${label}: ${what.filter(Boolean).join(", ")}` : "";
}
