// How far apart two runs are at each frame, a small plot for each method.
import { element } from "./element.js";
import { made } from "./svg.js";
import { digits, shownUnit } from "./units.js";

const WIDTH = 1000;
const HEIGHT = 46;

// `index` is the frame that is shown; a click asks for another one.
export function drawCurves(place, curves, total, index, seek) {
  if (place.dataset.of !== JSON.stringify([curves, total])) {
    place.dataset.of = JSON.stringify([curves, total]);
    place.replaceChildren(element("h2", "", "Distance between A and B"), ...curves.map((curve) => plot(curve, total, seek)));
    if (!curves.length) place.append(element("p", "quiet", "No frame yet at which both have a pose."));
  }
  for (const [i, box] of [...place.querySelectorAll(".curve")].entries()) moveTo(box, curves[i], total, index);
}

function plot({ label, colour, unit, step, values }, total, seek) {
  const box = element("div", "curve");
  const highest = Math.max(...values.filter((value) => value !== null), 0);
  const scale = shownUnit(unit, highest);
  const head = box.appendChild(element("p"));
  const dot = head.appendChild(element("i"));
  dot.style.background = colour;
  head.append(element("b", "", label), element("span", "quiet", ` up to ${digits(highest * scale.factor)} ${scale.name || "(own unit)"}`), element("span", "now"));
  const svg = made("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": `${label}: distance between A and B over the frames` });
  const x = (i) => (i * step * WIDTH) / Math.max(total - 1, 1);
  const points = values.map((value, i) => (value === null ? "" : `${x(i).toFixed(1)},${(HEIGHT - 3 - ((HEIGHT - 8) * value) / (highest || 1)).toFixed(1)}`));
  svg.append(made("polyline", { points: points.filter(Boolean).join(" "), stroke: colour }));
  svg.append(made("line", { class: "cursor", y1: 0, y2: HEIGHT }));
  svg.addEventListener("click", ({ clientX }) => {
    const { left, width } = svg.getBoundingClientRect();
    seek(Math.round(((clientX - left) / width) * (total - 1)));
  });
  box.append(svg);
  return box;
}

function moveTo(box, { step, values, unit }, total, index) {
  const x = (Math.max(index, 0) * WIDTH) / Math.max(total - 1, 1);
  for (const end of ["x1", "x2"]) box.querySelector(".cursor").setAttribute(end, x);
  const value = values[Math.floor(index / step)];
  const scale = shownUnit(unit, value ?? 1);
  box.querySelector(".now").textContent = value === null || value === undefined ? "" : ` · here ${digits(value * scale.factor)} ${scale.name}`;
}
