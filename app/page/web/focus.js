// Each exposure's cards under Why are new HTML: the check that had the focus in those before keeps it.
export function keepFocus(page) {
  let focused;
  const seen = ({ target }) => (focused = target.closest?.("[data-plot]")?.dataset.plot);
  for (const kind of ["focusin", "pointerdown"]) page.addEventListener(kind, seen);
  new MutationObserver(() => {
    if (focused && page.activeElement === page.body) page.querySelector(`[data-plot="${CSS.escape(focused)}"]`)?.focus({ preventScroll: true });
  }).observe(page.body, { childList: true, subtree: true });
}
