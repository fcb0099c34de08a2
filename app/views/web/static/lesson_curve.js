// A question that is answered by drawing a curve, and the run's own curve over it.
import { made } from "./svg.js";

const WIDTH = 340,
  HEIGHT = 170,
  LEFT = 34,
  BOTTOM = 30,
  TOP = 8,
  RIGHT = 14;
const ACROSS = WIDTH - LEFT - RIGHT,
  UP = HEIGHT - TOP - BOTTOM;
const TICKS = 4;

export function draw(into, { x, y, x_range: [x0, x1], y_range: [y0, y1], at }, answer) {
  const column = (value) => LEFT + (ACROSS * (value - x0)) / (x1 - x0);
  const row = (value) => TOP + (UP * (y1 - Math.min(Math.max(value, y0), y1))) / (y1 - y0);
  const line = (heights) =>
    heights.map((value, i) => (value === null ? "" : `${column(at[i]).toFixed(1)},${row(value).toFixed(1)}`)).join(" ");
  const chart = made("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `draw ${y} over ${x}` });
  for (let i = 0; i <= TICKS; i++) {
    const [across, up] = [x0 + ((x1 - x0) * i) / TICKS, y0 + ((y1 - y0) * i) / TICKS];
    chart.append(made("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: row(up), y2: row(up), class: "grid" }));
    chart.append(label(plain(up), LEFT - 4, row(up) + 4, "end"), label(plain(across), column(across), HEIGHT - BOTTOM + 13, "middle"));
  }
  chart.append(label(x, LEFT + ACROSS / 2, HEIGHT - 3, "middle"));
  const own = chart.appendChild(made("polyline", { class: "yours" }));
  const run = chart.appendChild(made("polyline", { class: "right" }));
  const title = Object.assign(document.createElement("p"), {
    textContent: `${y}: drag from left to right over the whole width.`,
    className: "quiet",
  });
  into.append(title, chart);

  let drawn = at.map(() => null);
  let open = true;
  let last = null;
  const put = (event) => {
    const { left, top, width } = chart.getBoundingClientRect();
    const [u, v] = [event.clientX - left, event.clientY - top].map((each) => (each / width) * WIDTH);
    const step = (at[at.length - 1] - at[0]) / (at.length - 1);
    const i = Math.min(Math.max(Math.round((x0 + ((u - LEFT) / ACROSS) * (x1 - x0) - at[0]) / step), 0), at.length - 1);
    const value = Math.min(Math.max(y1 - ((v - TOP) / UP) * (y1 - y0), y0), y1);
    const from = last ?? [i, value];
    for (let k = Math.min(from[0], i); k <= Math.max(from[0], i); k++) {
      drawn[k] = i === from[0] ? value : from[1] + ((value - from[1]) * (k - from[0])) / (i - from[0]); // no gaps
    }
    last = [i, value];
    own.setAttribute("points", line(drawn));
  };
  chart.addEventListener("pointerdown", (event) => {
    if (!open) return;
    chart.setPointerCapture(event.pointerId);
    last = null;
    put(event);
  });
  chart.addEventListener("pointermove", (event) => chart.hasPointerCapture(event.pointerId) && put(event));
  chart.addEventListener("pointerup", () => {
    if (open && drawn.every((value) => value !== null)) answer(drawn);
  });
  return ({ yours, truth, open: asked }) => {
    open = asked;
    chart.style.cursor = open ? "crosshair" : "default";
    if (yours !== null) drawn = [...yours];
    own.setAttribute("points", line(drawn));
    run.setAttribute("points", truth ? line(truth) : "");
  };
}

const plain = (value) => String(Number(value.toPrecision(3)));

function label(text, x, y, anchor) {
  return Object.assign(made("text", { x, y, "text-anchor": anchor }), { textContent: text });
}
