// The keys of the run, wherever the focus is: on the page, in Rerun's canvas, or in viser's panel. Which they are, the
// server says (app/session/actions.py); "?" is the list's of them, and Escape closes that.
import { action, setActions } from "./actions.js";
import { hideKeys, listKeys, toggleKeys } from "./key_list.js";
import { frameAgain } from "./stage_view.js";

const TEXT = "textarea, select, input:not([type=checkbox], [type=radio], [type=range], [type=button]), [contenteditable=true]";
const LIST = "[aria-haspopup=listbox]"; // a text field as well: what is typed there searches in the list
const MOVED = "[role=slider], [role=tab], [role=radio], input:is([type=radio], [type=range]), #splitter"; // with the arrows, and with these:
const MOVES = ["ArrowLeft", "ArrowRight", "Home", "End", "Space"];
const PRESSED = "button, [role=checkbox], input[type=checkbox]";
const reached = new WeakSet(); // what got the focus by key: any key makes a button that was clicked look as if it had
let pointed = false; // whether the pointer was used last: a list that was clicked looks as if it had been reached by key
let names = {};

export function setKeys(keys) {
  names = Object.fromEntries(keys.map(({ key, name }) => [key, name]));
  setActions(keys);
  listKeys(keys);
}

export function listen(page, command) {
  page.addEventListener("pointerdown", () => (pointed = true), { capture: true });
  page.addEventListener("focusin", ({ target }) => reached[!pointed && target.matches(":focus-visible") ? "add" : "delete"](target));
  page.addEventListener(
    "keydown",
    (event) => {
      pointed = false;
      if (event.key === "Tab" && event.target.matches("canvas")) return event.stopImmediatePropagation(); // it would keep it
      const key = keyOf(event);
      const own = { "?": toggleKeys, f: frameAgain, Escape: hideKeys }[key];
      if (
        (!own && (!names[key] || document.body.dataset.sheet)) ||
        event.ctrlKey ||
        event.metaKey ||
        event.altKey ||
        keepsKey(event.target, key)
      )
        return;
      if (own) {
        if (!own()) return;
      } else command(action(names[key]));
      event.preventDefault();
      event.stopImmediatePropagation();
    },
    { capture: true },
  );
}

// Signs as they are, whatever it takes to write them; letters and named keys with their Shift.
function keyOf({ key, shiftKey }) {
  const plain = key === " " ? "Space" : key.toLowerCase() !== key.toUpperCase() && key.length === 1 ? key.toLowerCase() : key;
  return shiftKey && (plain.length > 1 || plain !== plain.toUpperCase()) ? `Shift+${plain}` : plain;
}

// Where text is typed, a list that is open, and what the key itself moves or presses, where the focus came by key: after a click the next
// keys are the run's. In a dialog a button is pressed.
function keepsKey(target, key) {
  if (target.matches(LIST)) return target.ariaExpanded === "true" || reached.has(target);
  if (target.matches(TEXT)) return true;
  if (target.matches(MOVED)) return MOVES.includes(key) && reached.has(target);
  return key === "Space" && target.matches(PRESSED) && (reached.has(target) || Boolean(target.closest("dialog")));
}
