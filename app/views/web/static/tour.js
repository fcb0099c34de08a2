// A short tour on the first start: what the parts of the page are for. It begins by itself once in a browser, and never
// where the browser could not remember that; later it is at the end of the list of the keys.
const SEEN = "ispom.tour";
const STEPS = [
  [
    "bar",
    "Methods",
    "Each dot is a method that estimates the camera's path. The number is the error of its trajectory so far (ATE; needs ground truth). Hover for details.",
  ],
  ["axis", "Time", "All frames of the recording, with each method's keyframes; red is lost. Click to jump. Space plays, ← and → step."],
  [
    "left",
    "Explain",
    "Explain says how each method is doing at this frame and which check decided it. Click a check to plot it, or an event to go there: n and N step through the events. Tracks shows single features.",
  ],
  [
    "left",
    "Try something else",
    "Change a setting in the tab Methods and press Fork: a second run continues from this frame with it. Compare, above, shows both frame by frame.",
  ],
  [
    "viewer",
    "Views",
    "Paths and images with their tracks at the frame shown. Click a track or a point to select it, a path to go there; f frames the path again. ISPOM, at the top left, opens the start screen with all runs.",
  ],
  ["help", "Keys", "? lists all keys, and has this tour. ⤓ beside it saves a picture of the page, and its numbers."],
];
const GAP = 10;
const at = (id) => document.getElementById(id);

// Whether there was anything to hide.
export function hideTour() {
  const open = at("tour").open;
  at("tour").close();
  at("tour-frame").hidden = true;
  return open;
}

export function makeTour() {
  const [card, frame] = [at("tour"), at("tour-frame")];
  const buttons = { back: at("tour-back"), next: at("tour-next"), skip: at("tour-skip") };
  let step = 0;
  const show = (wanted) => {
    if (wanted === STEPS.length) return hideTour();
    step = wanted;
    const [target, title, text] = STEPS[step];
    card.querySelector("b").textContent = title;
    card.querySelector("p").textContent = text;
    card.querySelector("span").textContent = `${step + 1} of ${STEPS.length}`;
    buttons.back.disabled = step === 0;
    buttons.next.textContent = step === STEPS.length - 1 ? "Done" : "Next";
    frame.hidden = false;
    if (!card.open) card.show();
    place(card, frame, at(target).getBoundingClientRect());
    buttons.next.focus();
  };
  buttons.back.addEventListener("click", () => show(step - 1));
  buttons.next.addEventListener("click", () => show(step + 1));
  buttons.skip.addEventListener("click", hideTour);
  addEventListener("resize", () => card.open && show(step));
  at("tour-again").addEventListener("click", () => {
    at("keys").close();
    show(0);
  });
  let begun = false;
  // With the first state that has something to show, and no lesson of its own.
  return (state) => {
    if (begun || state.index < 0 || document.querySelector(".sheet:not([hidden])") || state.address.lesson || !state.people.may_drive)
      return;
    begun = true;
    if (firstTime()) show(0);
  };
}

// Around the part that it is about, and the card below, in the middle, or else beside or in it: never on the controls.
function place(card, frame, { left, top, right, bottom }) {
  Object.assign(frame.style, { left: `${left}px`, top: `${top}px`, width: `${right - left}px`, height: `${bottom - top}px` });
  const { offsetWidth: width, offsetHeight: height } = card;
  const beside = right + GAP + width < innerWidth ? right + GAP : left - GAP - width;
  const low = bottom + GAP + height < innerHeight;
  const x = low ? (left + right - width) / 2 : beside > 0 ? beside : left + GAP;
  const y = low ? bottom + GAP : top + GAP;
  card.style.left = `${Math.max(GAP, Math.min(x, innerWidth - width - GAP))}px`;
  card.style.top = `${Math.max(GAP, Math.min(y, innerHeight - height - GAP))}px`;
}

// Also notes that it is not any more.
function firstTime() {
  try {
    const first = localStorage.getItem(SEEN) === null;
    localStorage.setItem(SEEN, "seen");
    return first;
  } catch {
    return false;
  }
}
