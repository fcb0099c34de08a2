// The keys of the run. viser has them as its commands; Rerun's canvas, the bar, and what has the focus in viser's panel get
// them here, once: a slider that stepped, too, would make two steps of one.
const KEYS = { " ": { do: "play" }, ArrowRight: { do: "step", by: 1 }, ArrowLeft: { do: "step", by: -1 } };

export function listen(page, command) {
  page.addEventListener("keydown", (event) => {
    const wanted = KEYS[event.key];
    if (!wanted || event.ctrlKey || event.metaKey || event.altKey || keepsKeys(event.target)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    command(wanted);
  }, { capture: true });
}

// Where text is typed, and what the arrows or the space move or press by themselves.
const keepsKeys = (target) =>
  target.matches("textarea, input:not([type=checkbox]), [role=slider], [role=tab], #splitter, button:focus-visible");
