// Three captions in the picture, for whoever is here for the first time: what one can do. They are gone at the first action,
// for good where the browser can remember that.
const SEEN = "ispom.captions";
const at = (id) => document.getElementById(id);

// To be called with each state; the captions show with the first one that has something to act on.
export function makeCaptions() {
  let over = seen();
  function act() {
    if (at("captions").hidden) return;
    [over, at("captions").hidden] = [true, true];
    remember();
  }
  for (const kind of ["pointerdown", "keydown", "wheel"]) addEventListener(kind, act, { capture: true, passive: true });
  addEventListener("blur", () => document.activeElement === at("controls") && act()); // the left pane is a page of its own
  return (state) => {
    const elsewhere = state.index < 0 || state.address.lesson || document.querySelector(".sheet:not([hidden])");
    at("captions").hidden = over || Boolean(elsewhere) || !state.people.may_drive;
  };
}

function seen() {
  try {
    return localStorage.getItem(SEEN) !== null;
  } catch {
    return false;
  }
}

function remember() {
  try {
    localStorage.setItem(SEEN, "seen");
  } catch {
    // They come again with the next page: nothing waits for them.
  }
}
