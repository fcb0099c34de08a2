// A run in a cell of a notebook: everything is in this page. What is chosen goes over a channel to the link (link.js), if there is one.

const data = JSON.parse(document.getElementById("data").textContent);
const part = (id) => document.getElementById(id);
const image = part("image");
const plan = part("plan");
const slider = part("slider");
const ids = part("ids");
const CLICK_PX = 12; // How near a click has to be to a track.
const DRAG_PX = 4; // Less than that is a click.
const WIDE = 2; // Ratio of width to height from which on the path is shown below an image.
const LOOK = { quiet: 0.6, dot: 2.5, chosen: 5, mark: 6 }; // Radii and opacity.

const frames = data.frames;
const path = data.path; // Columns: number of the frame, x, z.
const chosen = new Set(data.tracks);
let place = Math.max(
  0,
  frames.findIndex((frame) => frame.frame === data.start),
);

/** An element of a picture. */
function drawn(name, values, parent) {
  const found = document.createElementNS(parent.namespaceURI, name);
  for (const [key, value] of Object.entries(values)) found.setAttribute(key, value);
  parent.append(found);
  return found;
}

function pairs(frame) {
  return frame.status.map((_, i) => [frame.xy[2 * i], frame.xy[2 * i + 1]]);
}

/** How many units of a picture are one pixel of the screen. */
function unitsPerPixel(svg) {
  const scale = svg.getScreenCTM()?.a;
  return scale ? 1 / scale : 1;
}

function pointAt(svg, event) {
  const inverse = svg.getScreenCTM()?.inverse();
  const at = inverse ? new DOMPoint(event.clientX, event.clientY).matrixTransform(inverse) : { x: 0, y: 0 };
  return [at.x, at.y];
}

function drawImage(frame) {
  const [width, height] = frame.image ? frame.size : [4, 3];
  image.replaceChildren();
  image.setAttribute("viewBox", `0 0 ${width} ${height}`);
  image.classList.toggle("takes", frame.ids !== null);
  part("pictures").classList.toggle("wide", width > WIDE * height);
  if (!frame.image) {
    drawn("text", { x: 2, y: 1.6, "font-size": 0.2, "text-anchor": "middle" }, image).textContent = "no image of this frame";
    return;
  }
  drawn("image", { href: frame.image, width, height }, image);
  const unit = unitsPerPixel(image);
  drawTrails(unit);
  pairs(frame).forEach(([cx, cy], i) => {
    const selected = frame.ids !== null && chosen.has(frame.ids[i]);
    const colour = data.statuses[frame.status[i]]?.[1] ?? "#808080";
    const look = selected ? { stroke: "#fff", "stroke-width": 2 * unit } : { "fill-opacity": LOOK.quiet + 0.3 };
    const dot = drawn("circle", { cx, cy, r: unit * (selected ? LOOK.chosen : LOOK.dot), fill: colour, ...look }, image);
    if (frame.ids !== null) dot.dataset.track = frame.ids[i];
  });
}

/** Where the chosen tracks were, in the frames before that are here. */
function drawTrails(unit) {
  for (const id of chosen) {
    const points = frames.slice(0, place + 1).flatMap((frame) => {
      const row = frame.camera === frames[place].camera && frame.ids !== null ? frame.ids.indexOf(id) : -1;
      return row < 0 ? [] : [`${frame.xy[2 * row]},${frame.xy[2 * row + 1]}`];
    });
    if (points.length > 1)
      drawn("polyline", { points: points.join(" "), class: "line", stroke: "#fff", "stroke-width": 2, opacity: 0.9 * (unit > 0) }, image);
  }
}

/** The extent of the paths, at least of a thousandth of a unit: [left, bottom, width, height]. */
function extent() {
  const truth = data.truth ?? [[], []];
  const [xs, zs] = [
    [...path[1], ...truth[0]],
    [...path[2], ...truth[1]],
  ];
  const [left, bottom] = [Math.min(...xs), Math.min(...zs)];
  const size = Math.max(Math.max(...xs) - left, Math.max(...zs) - bottom, 1e-3);
  return xs.length
    ? [left, bottom, Math.max(Math.max(...xs) - left, size / 3), Math.max(Math.max(...zs) - bottom, size / 3)]
    : [0, 0, 1, 1];
}

/** A round length (1, 2 or 5 of a power of ten), at most a third of the width. */
function roundLength(width) {
  const power = 10 ** Math.floor(Math.log10(width / 3));
  return power * [5, 2, 1].find((factor) => factor * power <= width / 3);
}

function drawPlan() {
  const [left, bottom, width, height] = extent();
  const margin = 0.12 * Math.max(width, height);
  const box = [left - margin, -(bottom + height) - margin, width + 2 * margin, height + 2 * margin];
  plan.replaceChildren();
  plan.setAttribute("viewBox", box.join(" "));
  const line = (xs, zs, look) => drawn("polyline", { points: xs.map((x, i) => `${x},${-zs[i]}`).join(" "), class: "line", ...look }, plan);
  if (data.truth) line(...data.truth, { stroke: data.truthColour, "stroke-width": 4 });
  line(path[1], path[2], { stroke: data.colour, "stroke-width": 2 });
  const unit = unitsPerPixel(plan);
  const now = path[0].indexOf(frames[place]?.frame);
  if (now >= 0) {
    const look = { fill: data.colour, stroke: "#fff", "stroke-width": 2 * unit };
    drawn("circle", { cx: path[1][now], cy: -path[2][now], r: LOOK.mark * unit, id: "now", ...look }, plan);
  }
  const length = roundLength(box[2]);
  const [x, y] = [box[0] + 10 * unit, box[1] + box[3] - 10 * unit];
  line([x, x + length], [-y, -y], { stroke: "currentColor", "stroke-width": 2 });
  drawn("text", { x, y: y - 6 * unit, "font-size": 11 * unit }, plan).textContent = `${Number(length.toPrecision(1))} ${data.unit}`;
  part("about").textContent = `x →, z ↑: ${data.aboutPath}${data.truth ? ", over the true one" : ""}`;
}

function drawLegend(frame) {
  const counts = data.statuses.map((_, status) => frame.status.filter((other) => other === status).length);
  const items = data.statuses.flatMap(([reason, colour], status) => {
    if (!counts[status]) return [];
    const item = document.createElement("li");
    item.textContent = `${counts[status]} ${reason}`;
    item.style.setProperty("--colour", colour);
    return [item];
  });
  part("legend").replaceChildren(...items);
}

function drawChecks(frame) {
  const rows = frame.checks.map(([mark, tint, sentence]) => {
    const row = document.createElement("tr");
    row.className = tint;
    for (const text of [mark, sentence]) row.insertCell().textContent = text;
    return row;
  });
  part("checks").replaceChildren(...rows);
  document.querySelector("summary").textContent = rows.length === 1 ? "1 check" : `${rows.length} checks`;
}

function draw() {
  document.documentElement.classList.toggle("dark", isDark());
  const frame = frames[place];
  const [headline, detail] = part("verdict").children;
  slider.max = Math.max(frames.length - 1, 0);
  slider.value = place;
  slider.disabled = ids.disabled = !frame;
  document.querySelector("details").hidden = !frame;
  ids.value = [...chosen].join(", ");
  part("choice").hidden = Boolean(data.unknown);
  part("note").textContent = [data.note, data.unknown].filter(Boolean).join(" ");
  drawPlan();
  headline.textContent = frame ? `${data.label}, ${data.source}: ${frame.headline}` : `${data.label}, ${data.source}: no step yet`;
  part("verdict").className = frame?.severity ?? "quiet";
  detail.textContent = frame?.detail ?? "";
  part("at").textContent = frame ? `frame ${frame.frame} · ${frame.time_s.toFixed(3)} s${frame.camera && ` · ${frame.camera}`}` : "";
  if (!frame) return;
  drawImage(frame);
  drawLegend(frame);
  drawChecks(frame);
}

// The link to Python.

let channel = null;
try {
  channel = new BroadcastChannel(data.channel);
} catch {
  // The page is alone: it works, and nobody hears what is chosen.
}

function tell() {
  channel?.postMessage({ chosen: { frame: frames[place]?.frame ?? null, tracks: [...chosen] } });
}

function take({ frame, tracks }) {
  const found = frames.findIndex((each) => each.frame === frame);
  if (found >= 0) place = found;
  chosen.clear();
  for (const id of tracks) chosen.add(id);
  draw();
}

function learn({ added, dropped = [], untold = [] }) {
  const at = frames[place]?.frame;
  const keep = frames.filter((frame) => !dropped.includes(frame.frame) && frame.frame !== added?.frame.frame);
  frames.splice(0, frames.length, ...keep, ...(added ? [added.frame] : []));
  frames.sort((a, b) => a.frame - b.frame);
  for (const number of [...untold, ...(added ? [added.frame.frame] : [])]) {
    const row = path[0].indexOf(number);
    if (row >= 0) for (const column of path) column.splice(row, 1);
  }
  if (added?.place) [added.frame.frame, ...added.place].forEach((value, i) => path[i].push(value));
  const found = frames.findIndex((frame) => frame.frame === at);
  place = added || found < 0 ? Math.max(frames.length - 1, 0) : found;
  draw();
}

function greet() {
  channel?.postMessage({ hello: frames.map((frame) => frame.frame) });
}

if (channel)
  channel.onmessage = ({ data: message }) => {
    if (message.hail) greet();
    if (message.state) take(message.state);
    if (message.chosen) take(message.chosen); // another picture of the same view
    if (message.news) learn(message.news);
  };

// What a person does.

function goTo(next) {
  if (!frames[next] || next === place) return;
  place = next;
  draw();
  tell();
}

function choose(found, add) {
  if (!add) chosen.clear();
  for (const id of found) {
    if (add && found.length === 1 && chosen.has(id)) chosen.delete(id);
    else chosen.add(id);
  }
  draw();
  tell();
}

function nearest(frame, [x, y]) {
  const distances = pairs(frame).map(([u, v]) => Math.hypot(u - x, v - y));
  const best = distances.indexOf(Math.min(...distances));
  return distances[best] <= CLICK_PX * unitsPerPixel(image) ? [frame.ids[best]] : [];
}

function inside(frame, [x0, y0], [x1, y1]) {
  const within = (value, a, b) => value >= Math.min(a, b) && value <= Math.max(a, b);
  return frame.ids.filter((_, i) => within(frame.xy[2 * i], x0, x1) && within(frame.xy[2 * i + 1], y0, y1));
}

let drag = null;
image.addEventListener("pointerdown", (event) => {
  if (!frames[place] || frames[place].ids === null || event.button !== 0) return;
  drag = { from: pointAt(image, event), x: event.clientX, y: event.clientY, box: null };
  image.setPointerCapture(event.pointerId);
});
image.addEventListener("pointermove", (event) => {
  if (!drag || Math.hypot(event.clientX - drag.x, event.clientY - drag.y) < DRAG_PX) return;
  const [[x0, y0], [x1, y1]] = [drag.from, pointAt(image, event)];
  drag.box ??= drawn("rect", { class: "box" }, image);
  const box = { x: Math.min(x0, x1), y: Math.min(y0, y1), width: Math.abs(x1 - x0), height: Math.abs(y1 - y0) };
  for (const [key, value] of Object.entries(box)) drag.box.setAttribute(key, value);
});
image.addEventListener("pointerup", (event) => {
  if (!drag) return;
  const [frame, at, add] = [frames[place], pointAt(image, event), event.shiftKey || event.ctrlKey || event.metaKey];
  const found = drag.box ? inside(frame, drag.from, at) : nearest(frame, drag.from);
  drag = null;
  choose(found, add);
});
image.addEventListener("pointercancel", () => {
  drag = null;
  draw();
});
plan.addEventListener("click", (event) => {
  const [x, y] = pointAt(plan, event);
  const here = frames.map((frame) => path[0].indexOf(frame.frame));
  const distances = here.map((row) => (row < 0 ? Number.POSITIVE_INFINITY : Math.hypot(path[1][row] - x, -path[2][row] - y)));
  if (Number.isFinite(Math.min(...distances))) goTo(distances.indexOf(Math.min(...distances)));
});
slider.addEventListener("input", () => goTo(Number(slider.value)));
part("before").addEventListener("click", () => goTo(place - 1));
part("after").addEventListener("click", () => goTo(place + 1));
ids.addEventListener("change", () => choose((ids.value.match(/\d+/g) ?? []).map(Number).filter(Number.isSafeInteger), false));

/** Whether the notebook around is dark: its words are light there. */
function isDark() {
  try {
    const colour = getComputedStyle(frameElement.parentElement).color;
    const [red, green, blue] = colour.startsWith("rgb") ? colour.match(/[\d.]+/g).map(Number) : [];
    if (blue !== undefined) return 0.3 * red + 0.6 * green + 0.1 * blue > 128;
  } catch {
    // There is no notebook around, or it is of another origin.
  }
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

/** The cell is as high as the page. */
function fit() {
  try {
    if (frameElement) frameElement.style.height = `${Math.ceil(document.querySelector("main").getBoundingClientRect().height) + 2}px`;
  } catch {
    // A frame of another origin: it keeps the height that it has.
  }
}

draw();
new ResizeObserver(() => {
  fit();
  draw();
}).observe(document.querySelector("main"));
greet();
