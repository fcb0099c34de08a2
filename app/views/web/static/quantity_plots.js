// The stacked plots of the time dock: what the server sent of each curve, and its picture. A click on a check adds a plot.
import { element } from "./element.js";
import { GUTTER, placeOf } from "./time_scale.js";
import { digits, shownUnit } from "./units.js";

const LEAST_HEIGHT = 46;
const LINE = 14; // of a value
const EDGE = 5; // free above and below the curves
const FAR = 8; // A threshold above this multiple of the largest value is not drawn: the curves would be flat.

export function makePlots(box, command) {
  const curves = new Map(); // by id: { frames, values }, only ever appended to
  const logarithmic = new Set(["error", "error_m"]); // names of plots
  let rows = [];

  function take(news) {
    if (news.choices) {
      curves.clear();
      listChoices(news.choices);
    }
    if (news.plots) rows = news.plots.map((plot) => makeRow(plot));
    if (news.plots) box.replaceChildren(...rows.map((row) => row.element));
    for (const [id, frames, values] of news.values ?? []) {
      if (!curves.has(id)) curves.set(id, { frames: [], values: [] });
      const curve = curves.get(id);
      for (let i = 0; i < frames.length; i++) {
        curve.frames.push(frames[i]);
        curve.values.push(values[i] ?? NaN);
      }
    }
    for (const [id, frames, values] of news.errors ?? []) curves.set(id, { frames, values: values.map((value) => value ?? NaN) });
    const wanted = new Set(rows.flatMap(({ plot }) => plot.curves.map(({ id }) => id)));
    for (const id of [...curves.keys()]) if (!wanted.has(id)) curves.delete(id);
  }

  function makeRow(plot) {
    const element = document.createElement("div");
    element.className = "plot";
    element.dataset.name = plot.name;
    const label = element.appendChild(document.createElement("div"));
    label.className = "label";
    const title = label.appendChild(document.createElement("b"));
    title.textContent = plot.title;
    title.title = `${plot.name}: ${plot.help}`;
    const unit = label.appendChild(document.createElement("span"));
    const scale = label.appendChild(
      button("log", `Logarithmic scale of ${plot.title}`, () => {
        if (!logarithmic.delete(plot.name)) logarithmic.add(plot.name);
        draw(last.axis, last.width);
      }),
    );
    label.append(button("×", `Closes the plot of ${plot.title}`, () => command({ do: "plot", name: plot.name })));
    const canvas = element.appendChild(document.createElement("canvas"));
    canvas.className = "drawing"; // not by its kind: a saved picture of the page has an image in its place
    const now = element.appendChild(document.createElement("div"));
    now.className = "now";
    const values = plot.curves.filter(({ threshold }) => !threshold).map((curve) => makeValue(curve, now));
    const height = Math.max(LEAST_HEIGHT, LINE * values.length + 4);
    element.style.height = `${height}px`;
    return { plot, element, unit, scale, canvas, values, height, shown: { name: plot.unit, factor: 1 } };
  }

  let last = { axis: { times: [] }, width: 0 };
  function draw(axis, width) {
    last = { axis, width };
    for (const row of rows) drawRow(row, axis, width);
  }

  function drawRow(row, axis, width) {
    const found = row.plot.curves.map((curve) => ({ ...curve, ...(curves.get(curve.id) ?? { frames: [], values: [] }) }));
    const isLog = logarithmic.has(row.plot.name);
    row.scale.setAttribute("aria-pressed", String(isLog));
    const range = rangeOf(found, isLog);
    row.shown = shownUnit(row.plot.unit, range?.[1] ?? 1);
    row.unit.textContent = row.shown.name;
    const ink = inkOf(row.canvas, width, row.height);
    if (!range || !axis.times.length) return;
    const [low, high] = range;
    const scaled = isLog ? Math.log10 : (value) => value;
    const span = scaled(high) - scaled(low) || 1;
    const y = (value) =>
      high > low ? row.height - EDGE - ((row.height - 2 * EDGE) * (scaled(value) - scaled(low))) / span : row.height / 2;
    const style = getComputedStyle(document.documentElement);
    for (const curve of found) {
      ink.strokeStyle = curve.threshold ? style.getPropertyValue("--quiet") : curve.colour;
      ink.lineWidth = curve.threshold ? 1 : 1.5;
      ink.setLineDash(curve.threshold ? [6, 4] : []);
      drawCurve(
        ink,
        curve,
        (frame) => placeOf(axis.times, width, frame),
        (value) => y(Math.min(Math.max(value, low), high)),
        isLog,
      );
    }
    ink.fillStyle = style.getPropertyValue("--quiet");
    ink.font = "10px Inter, system-ui, sans-serif";
    ink.textAlign = "right";
    ink.fillText(digits(high * row.shown.factor), GUTTER - 6, EDGE + 8);
    ink.fillText(digits(low * row.shown.factor), GUTTER - 6, row.height - EDGE);
  }

  // The values at the frame shown, in the unit of their row.
  function moveTo(index) {
    for (const { values, shown } of rows) {
      for (const { id, text } of values) {
        const now = digits(valueAt(curves.get(id), index) * shown.factor);
        if (text.textContent !== now) text.textContent = now;
      }
    }
  }

  // The values of a plot at a frame, in words.
  function hintAt(name, index) {
    const row = rows.find(({ plot }) => plot.name === name);
    if (!row) return [];
    return row.plot.curves
      .map((curve) => [curve.label, valueAt(curves.get(curve.id), index)])
      .filter(([, value]) => Number.isFinite(value))
      .map(([label, value]) => `${label}: ${digits(value * row.shown.factor)} ${row.shown.name}`.trim());
  }

  return {
    take,
    draw,
    moveTo,
    hintAt,
    get rows() {
      return rows;
    },
    curves,
  };
}

// Whose value it is, and the value: a line of a plot's values.
function makeValue({ id, label, colour }, place) {
  const line = place.appendChild(element("div"));
  line.style.setProperty("--colour", colour);
  line.append(element("span", "whose", label));
  return { id, text: line.appendChild(element("span", "value")) };
}

// The latest value of a curve up to a frame; NaN if there is none.
export function valueAt(curve, index) {
  if (!curve) return NaN;
  let low = 0;
  let high = curve.frames.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (curve.frames[middle] <= index) low = middle + 1;
    else high = middle;
  }
  return low ? curve.values[low - 1] : NaN;
}

// Lowest and highest value to draw; null without any. Far thresholds are cut off; a logarithmic scale has positive values only.
export function rangeOf(found, isLog) {
  const bounds = (curves) => {
    let [low, high] = [Infinity, -Infinity];
    for (const { values } of curves) {
      for (const value of values) {
        if (!Number.isFinite(value) || (isLog && value <= 0)) continue;
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    return [low, high];
  };
  let [low, high] = bounds(found.filter((curve) => !curve.threshold));
  if (low > high) return null;
  const [least, most] = bounds(found.filter((curve) => curve.threshold));
  if (least <= most) {
    const [lower, upper] = [Math.min(low, least), Math.max(high, most)];
    if (isLog || upper - lower <= FAR * Math.max(Math.abs(low), Math.abs(high))) [low, high] = [lower, upper];
  }
  if (!isLog && low > 0 && low < 0.5 * high) low = 0;
  return [low, high];
}

// A line through the values of successive steps. Of several values in one pixel column, the lowest and the highest are drawn.
function drawCurve(ink, { frames, values }, x, y, isLog) {
  ink.beginPath();
  let drawing = false;
  let column = null; // { x, first, low, high, last } of the pixel column being gathered
  const flush = () => {
    if (!column) return;
    if (!drawing) ink.moveTo(column.x, column.first);
    else ink.lineTo(column.x, column.first);
    if (column.low !== column.high) {
      ink.lineTo(column.x, column.low);
      ink.lineTo(column.x, column.high);
      ink.lineTo(column.x, column.last);
    } else if (!drawing) ink.lineTo(column.x + 0.8, column.first);
    drawing = true;
    column = null;
  };
  for (let i = 0; i < frames.length; i++) {
    if (!Number.isFinite(values[i]) || (isLog && values[i] <= 0)) {
      flush();
      drawing = false;
      continue;
    }
    const [across, height] = [Math.round(x(frames[i]) * 2) / 2, y(values[i])];
    if (column?.x !== across) {
      flush();
      column = { x: across, first: height, low: height, high: height, last: height };
    } else {
      column.low = Math.min(column.low, height);
      column.high = Math.max(column.high, height);
      column.last = height;
    }
  }
  flush();
  ink.stroke();
}

// A canvas' context, cleared, in CSS pixels. It is drawn by the processor: with software graphics, thousands of marks in the
// graphics process hold up all other pictures.
export function inkOf(canvas, width, height) {
  const scale = devicePixelRatio;
  Object.assign(canvas, { width: width * scale, height: height * scale });
  const ink = canvas.getContext("2d", { willReadFrequently: true });
  ink.scale(scale, scale);
  return ink;
}

function button(text, title, press) {
  const made = document.createElement("button");
  made.type = "button";
  Object.assign(made, { textContent: text, title });
  made.setAttribute("aria-label", title);
  made.addEventListener("pointerdown", (event) => event.stopPropagation()); // no seek
  made.addEventListener("click", press);
  return made;
}

// What can be added: a person types a few letters of it.
function listChoices(choices) {
  const list = document.getElementById("quantities");
  list.replaceChildren(
    ...choices.map(([name, title]) => {
      const option = document.createElement("option");
      option.value = name;
      option.textContent = title;
      return option;
    }),
  );
}
