// The picture of the time axis, row by row: video exposures, stereo exposures, each method's key frames and losses, events,
// where the condition holds, what is computed. At most one mark of a kind to a pixel.
export const PAD = 8;
const TICKS = 6;
const LANE = 7;
const BAR = 3;
const EVENTS = 9;
const COLOURS = { lost: "alarm", warning: "caution" }; // of events that are not good news
const rows = (axis) => axis.methods.length + (axis.condition ? 1 : 0);
const eventRow = (axis) => (axis.events?.length ? EVENTS : 0);

export const heightOf = (axis) => 2 + 2 * TICKS + rows(axis) * LANE + eventRow(axis) + BAR + 2;

// What the row at this height shows.
export function laneAt(axis, y) {
  if (y < 2 + TICKS) return "Video exposures";
  if (y < 2 + 2 * TICKS) return "Stereo exposures";
  const below = y - 2 - 2 * TICKS - axis.methods.length * LANE;
  if (below >= 0 && below < eventRow(axis)) return "Events (n and N step through them)";
  const row = Math.floor((y - 2 - 2 * TICKS - (below < 0 ? 0 : eventRow(axis))) / LANE);
  if (row < axis.methods.length) return `${axis.methods[row].label}: marks are key frames, red is lost`;
  return row < rows(axis) ? `Where ${axis.condition} holds` : y < heightOf(axis) ? "Bar: computed so far" : "";
}

export function drawAxis(canvas, width, axis, place) {
  const scale = devicePixelRatio;
  const height = heightOf(axis);
  Object.assign(canvas, { width: width * scale, height: height * scale });
  // Drawn here and not by the graphics' process: where that is software, thousands of marks hold up all other pictures.
  const ink = canvas.getContext("2d", { willReadFrequently: true });
  ink.scale(scale, scale);
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`);
  const box = (from, to, y, tall, fill, alpha = 1) => {
    Object.assign(ink, { fillStyle: fill, globalAlpha: alpha });
    ink.fillRect(from, y, Math.max(to - from, 1), tall);
  };
  const marks = (indices, y, tall, fill, wide = 1) => {
    let last = -1;
    for (const index of indices) {
      const x = Math.round(place(index));
      if (x > last) box((last = x), x + wide, y, tall, fill);
    }
  };
  if (!axis.times.length) return;
  if (axis.loop) box(place(axis.loop[0]), place(axis.loop[1] ?? axis.times.length - 1), 0, height, colour("accent"), 0.22);
  const all = [...axis.times.keys()];
  marks(all.filter((i) => axis.kinds[i] === "v"), 2, TICKS - 1, colour("quiet"));
  marks(all.filter((i) => axis.kinds[i] === "s"), 2 + TICKS, TICKS - 1, colour("text"));
  let y = 2 + 2 * TICKS;
  for (const { colour: own, keyFrames, lost } of axis.methods) {
    box(place(0), place(Math.max(axis.computed - 1, 0)), y + LANE / 2, 1, own, 0.5);
    for (const [first, last] of lost) box(place(first), place(last + 1), y + 1, LANE - 2, colour("alarm"));
    marks(keyFrames, y, LANE - 1, own, 2);
    y += LANE;
  }
  for (const { at, severity } of axis.events ?? []) {
    const x = Math.round(place(at));
    const fill = colour(COLOURS[severity] ?? "good");
    for (let wide = 0; wide < 4; wide++) box(x - 3 + wide, x + 4 - wide, y + 4 - wide, 1 + 2 * wide, fill);
  }
  y += eventRow(axis);
  if (axis.condition) {
    marks(axis.matches, y, LANE - 1, colour("text"), 2);
    y += LANE;
  }
  box(place(0), place(axis.times.length - 1), y + 1, BAR, colour("field"));
  if (axis.computed) box(place(0), place(axis.computed - 1), y + 1, BAR, colour("accent"), 0.6);
  for (const bookmark of axis.bookmarks ?? []) {
    const x = Math.round(place(bookmark.at));
    box(x, x + 1, 0, height, colour("accent"));
    for (let wide = 0; wide < 5; wide++) box(x - wide, x + 1 + wide, 4 - wide, 1, colour("accent"));
  }
  for (const branch of axis.branches) {
    box(place(branch.at) - 1, place(branch.at) + 1, 0, height, branch.colour);
    box(place(branch.at) - 1, place(branch.at) + 7, 0, 5, branch.colour);
  }
}
