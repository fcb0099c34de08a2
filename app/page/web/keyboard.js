// The keys of the run, wherever the focus is: on the page, in Rerun's canvas, or in viser's panel.
const KEYS = { " ": { do: "play" }, ArrowRight: { do: "step", by: 1 }, ArrowLeft: { do: "step", by: -1 } };
const OWN_KEYS = "textarea, input:not([type=checkbox]), [role=slider], [role=tab], #splitter, button:focus-visible";

export function listen(page, command) {
  page.addEventListener("keydown", (event) => {
    const wanted = KEYS[event.key];
    if (!wanted || event.ctrlKey || event.metaKey || event.altKey || keepsKeys(event.target)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    command(wanted);
  }, { capture: true });
}

// Where text is typed, and what the arrows move or the space presses; but the slider of the exposures steps with all else.
const keepsKeys = (target) => target.matches(OWN_KEYS) && labelOf(target) !== "exposure";

function labelOf(target) {
  let row = target;
  while (row && !row.querySelector("label")) row = row.parentElement;
  return target.matches("[role=slider]") ? row?.querySelector("label").textContent : null;
}
