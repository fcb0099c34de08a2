// How far apart two runs are at each frame, a small plot for each method.
import { element } from "./element.js";
import { valueAt } from "./quantity_plots.js";
import { made } from "./svg.js";
import { digits, shownUnit } from "./units.js";

const WIDTH = 1000;
const HEIGHT = 46;

// `index` is the frame that is shown; a click asks for another one.
export function drawCurves(place, curves, total, index, seek) {
  if (place.dataset.of !== JSON.stringify([curves, total])) {
    place.dataset.of = JSON.stringify([curves, total]);
    place.replaceChildren(element("h2", "", "Distance between A and B"), ...curves.map((curve) => plot(curve, total, seek)));
    if (!curves.length) place.append(element("p", "quiet", "No frame at which both have a pose."));
  }
  for (const [i, box] of [...place.querySelectorAll(".curve")].entries()) moveTo(box, curves[i], total, index);
}

function plot({ label, colour, how, metres, frames, values, parts_at: partsAt }, total, seek) {
  const box = element("div", "curve");
  const highest = Math.max(...values, 0);
  const scale = unitOf(metres, highest);
  const head = box.appendChild(element("p"));
  head.title = how;
  const dot = head.appendChild(element("i"));
  dot.style.background = colour;
  head.append(
    element("b", "", label),
    element("span", "quiet", ` up to ${digits(highest * scale.factor)} ${scale.name}`),
    element("span", "now"),
  );
  const svg = made("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    preserveAspectRatio: "none",
    role: "img",
    "aria-label": `${label}: distance between A and B over the frames`,
  });
  const x = (frame) => ((frame * WIDTH) / Math.max(total - 1, 1)).toFixed(1);
  const y = (value) => (HEIGHT - 3 - ((HEIGHT - 8) * value) / (highest || 1)).toFixed(1);
  svg.append(made("polyline", { points: values.map((value, i) => `${x(frames[i])},${y(value)}`).join(" "), stroke: colour }));
  if (partsAt !== null) svg.append(made("line", { class: "parts", x1: x(partsAt), x2: x(partsAt), y1: 0, y2: HEIGHT }));
  svg.append(made("line", { class: "cursor", y1: 0, y2: HEIGHT }));
  if (partsAt !== null) head.insertBefore(element("span", "", ` parts at frame ${partsAt} `), head.lastChild);
  svg.addEventListener("click", ({ clientX }) => {
    const { left, width } = svg.getBoundingClientRect();
    seek(Math.round(((clientX - left) / width) * (total - 1)));
  });
  box.append(svg);
  return box;
}

const unitOf = (metres, size) => (metres ? shownUnit("m", size) : { name: "units of A", factor: 1 });

function moveTo(box, { frames, values, metres }, total, index) {
  const x = (Math.max(index, 0) * WIDTH) / Math.max(total - 1, 1);
  for (const end of ["x1", "x2"]) box.querySelector(".cursor").setAttribute(end, x);
  const value = valueAt({ frames, values }, index);
  const scale = unitOf(metres, value);
  box.querySelector(".now").textContent = Number.isFinite(value) ? ` · here ${digits(value * scale.factor)} ${scale.name}` : "";
}
