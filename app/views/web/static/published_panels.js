// The left pane of a published page: what viser's panels show that needs no estimator. Its HTML was made when the run was
// published, by the templates of those panels (app/features/publish/panels.py).
import { element } from "./element.js";
import { listenToPanels } from "./panels.js";

const TABS = ["Explain", "View"];

export function openPublishedPanels(command) {
  const place = document.getElementById("left").appendChild(element("section", "panels"));
  place.ariaLabel = "Explanation of the frame shown, and layers of the views";
  document.getElementById("controls").remove();
  document.documentElement.classList.add("published");
  const bar = place.appendChild(element("div", "tabs"));
  bar.setAttribute("role", "tablist");
  const pages = Object.fromEntries(TABS.map((name) => [name, place.appendChild(page(name))]));
  const tabs = TABS.map((name) => bar.appendChild(tab(name, () => choose(name))));
  const parts = {}; // elements of the tab Explain, by the name of their HTML
  let made = null;
  let shown = null;

  const choose = (name) => {
    tabs.forEach((each) => {
      each.setAttribute("aria-selected", String(each.textContent === name));
      each.tabIndex = each.textContent === name ? 0 : -1;
    });
    for (const [each, page] of Object.entries(pages)) page.hidden = each !== name;
  };
  bar.addEventListener("keydown", ({ key }) => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[key];
    if (!by) return;
    const next = tabs[(tabs.indexOf(document.activeElement) + by + tabs.length) % tabs.length];
    choose(next.textContent);
    next.focus();
  });
  choose(TABS[0]);
  listenToPanels({ body: place }, command, () => {});

  function make(fixed) {
    made = fixed;
    parts.verdicts = pages.Explain.appendChild(element("div"));
    for (const [name, label] of Object.entries(fixed.folded)) {
      const folder = pages.Explain.appendChild(element("details"));
      folder.append(element("summary", "", label));
      parts[name] = folder.appendChild(element("div"));
    }
    parts.events = pages.Explain.appendChild(element("div"));
    parts.events.innerHTML = fixed.events;
    for (const note of fixed.notes) pages.Explain.append(element("p", "note", note));
    const boxes = pages.View.appendChild(element("fieldset"));
    boxes.append(element("legend", "", "What the views draw"));
    parts.boxes = fixed.layers.map(([name, label, hint]) => box(boxes, name, label, hint));
    for (const each of parts.boxes) each.addEventListener("change", () => command({ do: "hide", names: undrawn() }));
    pages.View.appendChild(element("div")).innerHTML = fixed.legend;
  }
  const undrawn = () => parts.boxes.filter(({ checked }) => !checked).map(({ name }) => name);

  return {
    follow: () => {},
    show: ({ panels: { fixed, frame, index, plotted, hidden } }) => {
      if (!made) make(fixed);
      if (frame && frame !== shown) {
        shown = frame;
        for (const [name, html] of Object.entries(frame)) if (parts[name].innerHTML !== html) parts[name].innerHTML = html;
      }
      for (const each of place.querySelectorAll("[data-plot]"))
        each.setAttribute("aria-pressed", String(plotted.includes(each.dataset.plot)));
      for (const each of parts.events.querySelectorAll("[data-seek]")) {
        const here = Number(each.dataset.seek) === index;
        each.classList.toggle("here", here);
        if (here) each.setAttribute("aria-current", "true");
        else each.removeAttribute("aria-current");
      }
      for (const each of parts.boxes) each.checked = !hidden.includes(each.name);
      place.dataset.index = frame ? index : "";
    },
  };
}

function page(name) {
  const made = element("div", "page");
  Object.assign(made, { id: `tab-${name}`, role: "tabpanel", ariaLabel: name });
  return made;
}

function tab(name, choose) {
  const made = element("button", "", name);
  Object.assign(made, { type: "button", role: "tab" });
  made.setAttribute("aria-controls", `tab-${name}`);
  made.addEventListener("click", choose);
  return made;
}

function box(place, name, label, hint) {
  const line = place.appendChild(element("label"));
  line.title = hint;
  const made = line.appendChild(Object.assign(document.createElement("input"), { type: "checkbox", name, checked: true }));
  line.append(label);
  return made;
}
