// What is drawn anew is new HTML: the element that had the focus in the old one keeps it. Where it is gone, the one in its place among its
// like has the focus until it is back; but no other check, as those of video and stereo take turns. Elements are told apart by what they ask
// for, or lead to.
const ASK = ["data-plot", "data-doctor", "data-select", "data-seek", "data-camera", "data-view", "href"];

const named = (element) => ASK.find((name) => element.hasAttribute(name));
const alike = (page, name) => [...page.querySelectorAll(`[${name}]`)].filter((each) => each.tabIndex >= 0);
const same = (elements, name, value) => elements.filter((each) => each.getAttribute(name) === value);

// What an element is known by when it is drawn anew: `nth` of those that ask for the same, in the `place` of its like; null if by nothing.
function known(page, element) {
  const name = named(element);
  if (!name) return null;
  const value = element.getAttribute(name);
  const like = alike(page, name);
  return { name, value, nth: same(like, name, value).indexOf(element), place: like.indexOf(element) };
}

function found(page, { name, value, nth, place }) {
  const like = alike(page, name);
  const equal = same(like, name, value);
  return equal[nth] ?? equal[0] ?? (name === "data-plot" ? null : like[Math.min(place, like.length - 1)]);
}

export function keepFocus(page) {
  let wanted = null;
  let restoring = false;
  const seen = ({ target }) => {
    if (restoring) return;
    const element = target.closest?.(ASK.map((name) => `[${name}]`).join());
    wanted = element && known(page, element);
  };
  for (const kind of ["focusin", "pointerdown"]) page.addEventListener(kind, seen);
  const restore = () => {
    if (!wanted || page.activeElement !== page.body || !page.hasFocus()) return; // never taken from another frame
    restoring = true;
    found(page, wanted)?.focus({ preventScroll: true });
    restoring = false;
  };
  new MutationObserver(restore).observe(page.body, { childList: true, subtree: true });
  page.defaultView.addEventListener("focus", restore);
}
