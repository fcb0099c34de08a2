// What the panels' own HTML asks for: an element with data-select, data-seek or data-pick is one that a click, or Enter,
// answers, and so is a button with data-plot, data-doctor or data-do, which holds a command (Enter and Space click it anyway); and which tab is open, for what nobody sees is not drawn.

const ASKS = "[data-select], [data-seek], [data-pick], [data-plot], [data-doctor], [data-do]";
const same = (one, other) => Object.keys(one.dataset).every((name) => name === "index" || one.dataset[name] === other.dataset[name]);

export function listenToPanels(page, command, tabOpened) {
  const body = page.body;
  let pressed = null;
  const asked = (event) => {
    const element = event.target.closest?.(ASKS);
    if (!element) return;
    const { select, seek, pick, plot, doctor, do: asks } = element.dataset;
    if (asks !== undefined && event.type !== "keydown") command(JSON.parse(asks));
    if (seek !== undefined) command({ do: "seek", index: Number(seek) });
    if (select !== undefined) command({ do: "select", what: select });
    if (plot !== undefined && event.type !== "keydown") command({ do: "plot", name: plot });
    if (doctor !== undefined && event.type !== "keydown") {
      command({ do: "examine", at: Number(doctor) });
      body.querySelector("[data-cause]")?.scrollIntoView({ block: "center" }); // the answer stands above the events
    }
    if (pick !== undefined && event.type !== "keydown") command({ do: "pick", camera: pick, ...place(element, event) });
  };
  body.addEventListener("click", asked);
  // Where a panel is drawn anew between press and release there is no click: what asks for the same then stands for what was pressed.
  body.addEventListener("pointerdown", ({ target }) => (pressed = target.closest?.(ASKS)));
  body.addEventListener("pointerup", (event) => {
    const element = event.target.closest?.(ASKS);
    if (element && pressed && !pressed.isConnected && same(pressed, element)) asked(event);
    pressed = null;
  });
  body.addEventListener("keydown", (event) => event.key === "Enter" && asked(event));
  const watch = () => tabOpened(body.querySelector("[role=tab][aria-selected=true]")?.textContent ?? "");
  new MutationObserver(watch).observe(body, { subtree: true, childList: true, attributeFilter: ["aria-selected"] });
}

// The pixel of the image that was clicked: its centre, not its corner, has whole numbers.
function place(picture, { clientX, clientY }) {
  const { left, top, width, height } = picture.getBoundingClientRect();
  const [, , columns, rows] = picture.getAttribute("viewBox").split(" ").map(Number);
  const u = ((clientX - left) / width) * columns - 0.5;
  const v = ((clientY - top) / height) * rows - 0.5;
  return { index: Number(picture.dataset.index), u, v };
}
