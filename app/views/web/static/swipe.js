// The images of one frame in two runs, or with the tracks of two methods of one, one over the other: the handle moves the
// border between them.
import { element } from "./element.js";

export function makeSwipe(place) {
  const stack = place.appendChild(element("div", "stack"));
  const images = ["A", "B"].map((name) => {
    const image = stack.appendChild(document.createElement("img"));
    Object.assign(image, { className: `image-${name.toLowerCase()}`, alt: `Image of ${name}`, hidden: true });
    stack.append(element("span", `tag side-${name.toLowerCase()}`, name));
    return image;
  });
  const handle = stack.appendChild(document.createElement("input"));
  Object.assign(handle, {
    type: "range",
    min: 0,
    max: 100,
    value: 50,
    ariaLabel: "Border between the images of A and B",
    title: "Drag: A is at its left, B at its right",
  });
  const move = () => stack.style.setProperty("--border", `${handle.value}%`);
  handle.addEventListener("input", move);
  move();
  const caption = place.appendChild(element("figcaption"));
  const text = caption.appendChild(element("span"));
  const label = caption.appendChild(element("span", "", "tracks of "));
  const choices = ["A", "B"].map((name) => {
    const choice = label.appendChild(document.createElement("select"));
    choice.ariaLabel = `Method whose tracks are drawn in ${name}`;
    choice.addEventListener("change", () => load());
    return choice;
  });
  let wanted = null; // { numbers, index }
  let shown = ""; // key of what is shown
  let busy = false;

  // Both images change together, when both are there; a frame that was passed meanwhile is not loaded.
  async function load() {
    if (busy || !wanted) return;
    const { numbers, index } = wanted;
    const methods = choices.map(({ value }) => value);
    const key = JSON.stringify([numbers, index, methods]);
    if (key === shown || index < 0) return;
    busy = true;
    const loaded = await Promise.all(numbers.map((branch, i) => image(branch, index, methods[i])));
    busy = false;
    shown = key;
    loaded.forEach((source, i) => {
      URL.revokeObjectURL(images[i].src);
      images[i].hidden = !source;
      images[i].src = source;
      images[i].alt = source ? `Frame ${index} of run ${"AB"[i]}` : "";
    });
    const missing = loaded.map((source, i) => (source ? "" : "AB"[i])).filter(Boolean);
    text.textContent = `Frame ${index}${missing.length ? `: no image of ${missing.join(" and ")}` : ""}`;
    load();
  }

  return {
    show: (visible) => (place.hidden = !visible),
    // `areOne`: both images are of one run, so that B has another method than A.
    methods: (methods, areOne) => {
      const key = JSON.stringify([methods, areOne]);
      if (label.dataset.of === key) return;
      label.dataset.of = key;
      choices.forEach((choice, i) => {
        choice.replaceChildren(...methods.map(([name, label]) => new Option(label, name)), new Option("no method", ""));
        choice.selectedIndex = areOne ? i : 0;
      });
    },
    at: (numbers, index) => {
      wanted = { numbers, index };
      load();
    },
  };
}

async function image(branch, at, method) {
  try {
    const answer = await fetch(`frame?${new URLSearchParams({ branch, at, method })}`);
    return answer.ok ? URL.createObjectURL(await answer.blob()) : "";
  } catch {
    return "";
  }
}
