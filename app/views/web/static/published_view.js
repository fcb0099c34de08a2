// The tab View of a published page: the layers of the views, as boxes, and their legend.
import { element } from "./element.js";

export function openPublishedView(command) {
  document.getElementById("controls").parentElement.remove();
  document.documentElement.classList.add("published");
  const page = element("div");
  let boxes = null;

  function make({ layers, legend }) {
    const place = page.appendChild(element("fieldset"));
    place.append(element("legend", "", "What the views draw"));
    boxes = layers.map(([name, label, hint]) => box(place, name, label, hint));
    for (const each of boxes) each.addEventListener("change", () => command({ do: "hide", names: undrawn() }));
    page.appendChild(element("div")).innerHTML = legend;
  }
  const undrawn = () => boxes.filter(({ checked }) => !checked).map(({ name }) => name);

  return {
    page,
    show({ pane: { fixed, hidden } }) {
      if (!boxes) make(fixed);
      for (const each of boxes) each.checked = !hidden.includes(each.name);
    },
  };
}

function box(place, name, label, hint) {
  const line = place.appendChild(element("label"));
  line.title = hint;
  const made = line.appendChild(Object.assign(document.createElement("input"), { type: "checkbox", name, checked: true }));
  line.append(label);
  return made;
}
