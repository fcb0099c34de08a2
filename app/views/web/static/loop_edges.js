// The loop on the time axis: its edges and the bar between them are dragged; the arrows move an edge that has the focus.
import { element } from "./element.js";

const EDGES = [
  ["start", "First frame of the loop"],
  ["end", "Last frame of the loop"],
];
const STEPS = { ArrowLeft: -1, ArrowRight: 1 };

// The loop [first, last] of a run with `count` frames after `part` ("start", "end" or "both") is dragged `by` frames.
export function moved([first, last], part, by, count) {
  const within = (frame, least, most) => Math.min(Math.max(frame, least), most);
  if (part === "start") return [within(first + by, 0, last - 1), last];
  if (part === "end") return [first, within(last + by, first + 1, count - 1)];
  const start = within(first + by, 0, count - 1 - (last - first));
  return [start, start + last - first];
}

// `box` has the rows of the axis, `frameAt` and `placeOf` say which frame is where, `change` asks for another loop.
export function makeLoopEdges(box, frameAt, placeOf, change) {
  const shade = box.appendChild(element("div", "loop-shade"));
  const bar = box.appendChild(element("div", "loop-bar"));
  bar.title = "Drag to move the loop";
  const edges = EDGES.map(([part, label]) => {
    const edge = box.appendChild(element("div", "loop-edge"));
    Object.assign(edge, { role: "slider", tabIndex: 0, ariaLabel: label, title: `${label}: drag it, or move it with the arrows` });
    edge.dataset.part = part;
    edge.addEventListener("keydown", ({ key }) => {
      if (STEPS[key] && loop) change(moved(whole(), part, STEPS[key], count));
    });
    return edge;
  });
  let loop = null; // as the session has it, or as it is dragged
  let count = 0;
  let dragged = null; // { part, from, loop } while a hand has it
  const whole = () => [loop[0], loop[1] ?? count - 1];

  function draw() {
    const parts = [shade, bar, ...edges];
    for (const part of parts) part.hidden = !loop || count < 2;
    if (!loop || count < 2) return;
    const frames = whole();
    const places = frames.map(placeOf);
    for (const part of [shade, bar]) Object.assign(part.style, { left: `${places[0]}px`, width: `${places[1] - places[0]}px` });
    edges.forEach((edge, i) => {
      edge.style.left = `${places[i]}px`;
      const [min, max] = i ? [frames[0] + 1, count - 1] : [0, frames[1] - 1];
      Object.assign(edge, { ariaValueMin: min, ariaValueMax: max, ariaValueNow: frames[i], ariaValueText: `frame ${frames[i]}` });
    });
  }

  for (const grip of [bar, ...edges]) {
    grip.addEventListener("pointerdown", (event) => {
      event.stopPropagation(); // no seek
      grip.setPointerCapture(event.pointerId);
      dragged = { part: grip.dataset.part ?? "both", from: frameAt(event), loop: whole() };
    });
    grip.addEventListener("pointermove", (event) => {
      if (!dragged || !grip.hasPointerCapture(event.pointerId)) return;
      loop = moved(dragged.loop, dragged.part, frameAt(event) - dragged.from, count);
      draw();
    });
    grip.addEventListener("lostpointercapture", () => {
      if (dragged && String(loop) !== String(dragged.loop)) change(loop);
      dragged = null;
    });
  }

  return (next, frames) => {
    count = frames;
    if (!dragged) loop = next;
    draw();
  };
}
