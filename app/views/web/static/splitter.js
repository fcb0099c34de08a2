// The border between the controls and the Rerun viewer. Remembered by the browser, where it allows that.
const NARROW = 380; // the width of viser's panel: less would cut its controls
const KEEP = 420; // pixels that the right side always has
const LEAST = matchMedia("(min-width: 900px)"); // of the window: in a smaller one the left pane is folded

export function makeSplitter() {
  makeFold(document.getElementById("fold"));
  const splitter = document.getElementById("splitter");
  const panes = document.getElementById("panes");
  let width = Number(read()) || NARROW;
  let wanted = width; // kept while a small window allows less
  const place = (asked) => {
    wanted = asked;
    width = Math.round(Math.min(Math.max(wanted, NARROW), Math.max(innerWidth - KEEP, NARROW)));
    panes.style.setProperty("--left", `${width}px`);
    splitter.ariaValueNow = String(width);
  };
  place(width);
  addEventListener("resize", () => place(wanted));
  splitter.addEventListener("pointerdown", (event) => {
    splitter.setPointerCapture(event.pointerId);
    document.body.classList.add("dragging");
  });
  splitter.addEventListener("pointermove", (event) => splitter.hasPointerCapture(event.pointerId) && place(event.clientX - 3));
  splitter.addEventListener("lostpointercapture", () => {
    document.body.classList.remove("dragging");
    write(width);
  });
  splitter.addEventListener("dblclick", () => {
    place(NARROW);
    write(width);
  });
  splitter.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -40, ArrowRight: 40 }[event.key];
    if (by) place(width + by);
  });
}

// Folds the left pane where the window is narrow, until a person wants to see it.
function makeFold(button) {
  const fold = (folded) => {
    document.body.classList.toggle("folded", folded);
    button.ariaExpanded = String(!folded);
  };
  const follow = () => {
    document.body.classList.toggle("narrow", !LEAST.matches);
    fold(!LEAST.matches);
  };
  button.addEventListener("click", () => fold(!document.body.classList.contains("folded")));
  LEAST.addEventListener("change", follow);
  follow();
}

function read() {
  try {
    return localStorage.getItem("ispom.left");
  } catch {
    return null;
  }
}

function write(width) {
  try {
    localStorage.setItem("ispom.left", width);
  } catch {
    // private mode: not remembered
  }
}
