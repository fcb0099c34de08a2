// The frame at which the paths of two runs part: both images with their tracks side by side, and a map of both paths there.
import { element } from "./element.js";
import { published } from "./published.js";
import { made } from "./svg.js";

const SIDES = ["A", "B"];
const SIZE = 200; // of the map
const EDGE = 22;

// `seek` asks for a frame.
export function makePlace(box, seek) {
  const sentence = box.appendChild(element("p", "headline"));
  const row = box.appendChild(element("div", "images"));
  const images = SIDES.map((side) => {
    const figure = row.appendChild(element("figure"));
    const image = figure.appendChild(document.createElement("img"));
    figure.append(element("span", `tag side-${side.toLowerCase()}`, side));
    image.addEventListener("load", () => ended(image, true));
    image.addEventListener("error", () => ended(image, false));
    return image;
  });
  const map = box.appendChild(element("div", "map"));
  const caption = box.appendChild(element("p", "which quiet"));
  const choice = ["Where they part", "Frame shown"].map((text, i) => {
    const button = element("button", "button", text);
    button.type = "button";
    button.addEventListener("click", () => {
      pinned = i === 0;
      draw();
    });
    return button;
  });
  const words = element("span");
  caption.append(...choice, words);
  let pinned = true; // the images are of the frame where the paths part, not of the one that is shown
  let place = null;
  let wanted = null; // { numbers, run, index }
  let waiting = 0; // images that are on their way

  // `pictures` are the images where the paths part, of a published page: nobody draws others there.
  function show(view, pictures) {
    box.hidden = !view;
    if (!view) return;
    place = view.parting;
    sentence.replaceChildren();
    if (place) {
      const button = element("button", "link", "Go there");
      Object.assign(button, { type: "button", title: `Goes to frame ${place.frame}; the views show both paths there` });
      button.addEventListener("click", () => seek(place.frame));
      sentence.append(`${place.sentence} `, button);
    } else if (view.curves.length) {
      const names = view.curves.map(({ label }) => label).join(", ");
      sentence.append(`The paths of ${names} stay together: noise explains how far they are apart.`);
    } else sentence.append("No path can be compared: too few frames have a pose in both.");
    map.hidden = !place;
    if (place) map.replaceChildren(drawMap(place));
    choice[0].hidden = !place;
    row.hidden = published && !pictures;
    caption.hidden = published;
    if (pictures && place) images.forEach((image, i) => draws(image, i, place.frame, pictures[i]));
    draw();
  }

  function at(numbers, run, index) {
    wanted = { numbers, run, index };
    draw();
  }

  // A frame that was passed while images were on their way is not asked for.
  function draw() {
    choice.forEach((button, i) => {
      button.ariaPressed = String((pinned && place !== null) === (i === 0));
    });
    if (!wanted || waiting || published) return;
    const index = pinned && place ? place.frame : wanted.index;
    const key = JSON.stringify([wanted.numbers, wanted.run, index, place?.method]);
    if (row.dataset.of === key || index < 0) return;
    row.dataset.of = key;
    words.textContent = `Frame ${index}${place ? `, tracks of ${place.label}` : ""}`;
    waiting = images.length;
    images.forEach((image, i) => {
      const query = { branch: wanted.numbers[i], at: index, run: wanted.run, method: place?.method ?? "" };
      draws(image, i, index, `frame?${new URLSearchParams(query)}`);
    });
  }

  function draws(image, i, index, address) {
    image.src = address;
    image.alt = `Image of frame ${index} of run ${SIDES[i]}`;
  }

  function ended(image, there) {
    image.classList.toggle("missing", !there);
    waiting -= 1;
    if (!waiting) draw();
  }

  return { show, at };
}

// Both paths around the frame, and the truth, each with its name at its end.
function drawMap({ paths, here, frame, label }) {
  const all = Object.values(paths).flat();
  const [low, high] = [Math.min, Math.max].map((of) => [0, 1].map((i) => of(...all.map((point) => point[i]))));
  const span = Math.max(high[0] - low[0], high[1] - low[1]) || 1;
  const at = ([x, y]) => {
    const place = [x - (low[0] + high[0]) / 2, (low[1] + high[1]) / 2 - y];
    return place.map((value) => (SIZE / 2 + (value * (SIZE - 2 * EDGE)) / span).toFixed(1));
  };
  const svg = made("svg", {
    viewBox: `0 0 ${SIZE} ${SIZE}`,
    role: "img",
    "aria-label": `Paths of ${label} around frame ${frame}: A, B${paths.truth ? " and the ground truth" : ""}`,
  });
  for (const [name, points] of Object.entries(paths).reverse()) {
    if (!points.length) continue;
    const kind = `path-${name.toLowerCase()}`;
    svg.append(made("polyline", { class: kind, points: points.map((point) => at(point).join(",")).join(" ") }));
    const [x, y] = at(points.at(-1));
    const text = made("text", { class: kind, x, y, dx: 4, dy: { A: -4, B: 12 }[name] ?? 4 });
    text.textContent = name;
    svg.append(text);
  }
  for (const [name, point] of Object.entries(here)) {
    const [cx, cy] = at(point);
    svg.append(made("circle", { class: `path-${name.toLowerCase()}`, cx, cy, r: 4 }));
  }
  return svg;
}
