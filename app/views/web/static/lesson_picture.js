// A question that is answered by a click on a track: the picture with its tracks, all alike until the answer is known.
import { made } from "./svg.js";

export function point(into, { image, width, height, dots }, answer) {
  if (!image) {
    into.textContent = "The picture is being computed …";
    return () => {};
  }
  const radius = width / 110;
  const picture = made("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "click on a track" });
  picture.append(made("image", { href: image, width, height }));
  const circles = dots.map(([id, cx, cy]) => made("circle", { cx, cy, r: radius, "data-id": id }));
  picture.append(...circles);
  const ring = picture.appendChild(made("circle", { r: 3 * radius, class: "yours", visibility: "hidden" }));
  into.append(picture);
  let open = true;
  picture.addEventListener("click", (event) => {
    const { left, top, width: shown } = picture.getBoundingClientRect();
    const [u, v] = [event.clientX - left, event.clientY - top].map((each) => (each / shown) * width);
    if (open && dots.length) answer(nearest(dots, u, v)[0]);
  });
  return ({ yours, truth, open: asked }) => {
    open = asked;
    picture.style.cursor = open ? "crosshair" : "default";
    const own = dots.find(([id]) => id === yours);
    if (own)
      for (const [name, value] of [
        ["cx", own[1]],
        ["cy", own[2]],
        ["visibility", "visible"],
      ])
        ring.setAttribute(name, value);
    for (const [i, [id]] of truth ? dots.entries() : []) circles[i].classList.toggle("right", truth.includes(id));
  };
}

function nearest(dots, u, v) {
  const away = ([, x, y]) => (x - u) ** 2 + (y - v) ** 2;
  return dots.reduce((best, dot) => (away(dot) < away(best) ? dot : best));
}
