// The upper part of the time dock, row by row: frame numbers, the frames and measurements of each sensor with its outages,
// each method's keyframes and losses, and what features mark. At most one mark of a kind to a pixel.
import { apart, GUTTER, labelledFrames } from "./time_scale.js";
import { inkOf } from "./quantity_plots.js";

const RULER = 21;
const CLOCK = 14;
const LANE = 15;
const LABEL_PX = 60; // between two frame numbers, where frames are even in time
const TOUCHING_PX = 30; // numbers that are nearer may touch
const BAR = 3; // what is computed
const EVENTS = 14;
const COLOURS = { lost: "alarm", warning: "caution" }; // of events that are not good news

const OUTAGE = 3; // times the usual interval between two measurements of a sensor

// The labels of the letters in the axis's kinds: those of frames here, those of sensors by the axis.
const FRAMES = { v: "Video frames", s: "Stereo frames", c: "Frames of cameras" };
const WORDS = { v: "video", s: "stereo", c: "cameras" };
const labelsOf = ({ sensors }) => ({ ...FRAMES, ...sensors });
const labelOf = (axis, kind) => labelsOf(axis)[kind];
export const wordOf = (axis, kind) => WORDS[kind] ?? labelOf(axis, kind); // of one frame or measurement
const clocks = (axis) => Object.keys(labelsOf(axis)).filter((kind) => axis.kinds.includes(kind));

// Stretches [first, last] of frames without any measurement of a sensor that has them at other times.
export function outagesOf({ times, kinds }, kind) {
  const own = [...times.keys()].filter((index) => kinds[index] === kind);
  const steps = own.slice(1).map((index, i) => times[index] - times[own[i]]);
  const usual = steps.toSorted((a, b) => a - b)[Math.floor(steps.length / 2)];
  if (!(usual > 0)) return [];
  const gaps = own.slice(1).flatMap((index, i) => (steps[i] > OUTAGE * usual ? [[own[i], index]] : []));
  const last = own.at(-1);
  return times.at(-1) - times[last] > OUTAGE * usual ? [...gaps, [last, times.length - 1]] : gaps;
}

const drawnAs = (axis, sign) => Object.values(axis.marks ?? {}).filter((kind) => kind.sign === sign);
const rowsOf = (axis) => drawnAs(axis, "row").filter(({ label }) => label);
const eventRow = (axis) => (axis.events?.length ? EVENTS : 0);

export const heightOf = (axis) =>
  RULER + CLOCK * clocks(axis).length + LANE * (axis.methods.length + rowsOf(axis).length) + eventRow(axis) + 2;

// What the row at this height shows.
export function laneAt(axis, y) {
  if (y < RULER) return "Frame numbers; the bar shows what is computed";
  const rows = clocks(axis);
  const clock = rows[Math.floor((y - RULER) / CLOCK)];
  if (clock) return clock in FRAMES ? FRAMES[clock] : `${labelOf(axis, clock)}: marks are measurements, red is an outage`;
  const below = y - RULER - CLOCK * rows.length - axis.methods.length * LANE;
  if (below >= 0 && below < eventRow(axis)) return "Events (n and N step through them)";
  const row = Math.floor((y - RULER - CLOCK * rows.length - (below < 0 ? 0 : eventRow(axis))) / LANE);
  if (row < axis.methods.length) return `${axis.methods[row].label}: marks are keyframes, red is lost`;
  return rowsOf(axis)[row - axis.methods.length]?.help ?? "";
}

export function drawAxis(canvas, width, axis, place) {
  const height = heightOf(axis);
  const ink = inkOf(canvas, width, height);
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`);
  const box = (from, to, y, tall, fill, alpha = 1) => {
    Object.assign(ink, { fillStyle: fill, globalAlpha: alpha });
    ink.fillRect(from, y, Math.max(to - from, 1), tall);
    ink.globalAlpha = 1;
  };
  const marks = (indices, y, tall, fill, wide = 1) => {
    let last = -1;
    for (const index of indices) {
      const x = Math.round(place(index));
      if (x > last) box((last = x), x + wide, y, tall, fill);
    }
  };
  const text = (words, x, y, fill, align = "left") => {
    Object.assign(ink, { fillStyle: fill, textAlign: align, font: "11px Inter, system-ui, sans-serif" });
    ink.fillText(words, x, y, GUTTER - 20);
  };
  if (!axis.times.length) return;
  const all = [...axis.times.keys()];
  box(place(0), place(all.length - 1), RULER - BAR - 1, BAR, colour("field"));
  if (axis.computed) box(place(0), place(axis.computed - 1), RULER - BAR - 1, BAR, colour("accent"), 0.6);
  for (const index of apart(labelledFrames(all.length, width / LABEL_PX), place, TOUCHING_PX)) {
    box(Math.round(place(index)), Math.round(place(index)) + 1, RULER - 5, 4, colour("quiet"));
    text(String(index), place(index), RULER - 8, colour("quiet"), "center");
  }
  let y = RULER;
  for (const kind of clocks(axis)) {
    text(labelOf(axis, kind), 14, y + CLOCK - 3, colour("quiet"));
    if (!(kind in FRAMES)) {
      for (const [first, last] of outagesOf(axis, kind)) box(place(first), place(last), y + 4, CLOCK - 8, colour("alarm"));
    }
    marks(
      all.filter((i) => axis.kinds[i] === kind),
      y + 3,
      CLOCK - 6,
      colour(kind === "s" ? "text" : "quiet"),
    );
    y += CLOCK;
  }
  for (const { label, colour: own, keyFrames, lost } of axis.methods) {
    text(label, 14, y + LANE - 4, colour("text"));
    box(place(0), place(Math.max(axis.computed - 1, 0)), y + LANE / 2 - 1, 2, own, 0.45);
    for (const [first, last] of lost) box(place(first), place(last + 1), y + LANE / 2 - 2, 4, colour("alarm"));
    marks(keyFrames, y + 2, LANE - 4, own, 2);
    y += LANE;
  }
  if (axis.events?.length) text("Events", 14, y + EVENTS - 3, colour("quiet"));
  for (const { at, severity } of axis.events ?? []) {
    const x = Math.round(place(at));
    const fill = colour(COLOURS[severity] ?? "good");
    for (let wide = 0; wide < 4; wide++) box(x - 3 + wide, x + 4 - wide, y + 7 - wide, 1 + 2 * wide, fill);
  }
  y += eventRow(axis);
  for (const row of rowsOf(axis)) {
    text(row.label, 14, y + LANE - 4, colour("text"));
    marks(
      row.marks.map(({ at }) => at),
      y + 2,
      LANE - 4,
      colour("text"),
      2,
    );
    y += LANE;
  }
  for (const mark of drawnAs(axis, "diamond").flatMap(({ marks }) => marks)) {
    const x = Math.round(place(mark.at));
    const own = mark.colour || colour("accent");
    box(x, x + 1, 0, height, own);
    for (let wide = 0; wide < 5; wide++) box(x - wide, x + 1 + wide, 4 - wide, 1, own);
  }
  for (const mark of drawnAs(axis, "flag").flatMap(({ marks }) => marks)) {
    const own = mark.colour || colour("accent");
    box(place(mark.at) - 1, place(mark.at) + 1, 0, height, own);
    box(place(mark.at) - 1, place(mark.at) + 7, 0, 5, own);
  }
}
