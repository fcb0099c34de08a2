// The eye of Rerun's 3-D view: it frames the path until a person moves it, or goes where one of the buttons says. The
// server says where that is (app/features/stage/page_message.py).
import { asBlueprint, divided, withinWidth } from "./stage_layout.js";
import { updateBlueprint } from "./viewer_control.js";

const ON_ALL = ["frame", "top", "side"]; // eyes that are to have all paths in sight
const MOVED_PX = 4; // a press that moves less is a click
const at = (id) => document.getElementById(id);
let frame = () => false;

// The key f.
export const frameAgain = () => frame();

// `control` sends a message to the viewer, and returns whether the viewer took it.
export function makeEye(canvas, control) {
  const eye = { mode: "frame", known: {}, sent: null, busy: false, division: null, arranged: null };
  const again = () => eye.store && arrange(eye, control);
  for (const part of [at("viewer"), at("at-image")]) new ResizeObserver(again).observe(part);
  const choose = (mode) => {
    Object.assign(eye, { mode, sent: null });
    push(eye, control);
    mark(eye);
    return true;
  };
  frame = () => choose("frame");
  for (const button of at("eyes").querySelectorAll("button")) button.addEventListener("click", () => choose(button.dataset.eye));
  watchHand(
    canvas,
    (x, y) => isWorld(eye, x, y),
    () => {
      eye.mode = null;
      mark(eye);
    },
  );
  mark(eye);
  return {
    get division() {
      return eye.division;
    },
    // What is new of the places, if anything; `store` is the recording that the viewer shows.
    follow: (news) => {
      if (news?.eye) Object.assign(eye, { known: {}, sent: null }); // another run has another layout
      Object.assign(eye.known, news ?? {});
    },
    show: (store) => {
      if (store !== eye.store) Object.assign(eye, { store, sent: null, arranged: null });
      arrange(eye, control);
      push(eye, control);
    },
  };
}

// One request at a time, and none for a place where the eye was put already.
async function push(eye, control) {
  const known = eye.known[eye.mode];
  const place = known && ON_ALL.includes(eye.mode) ? withinWidth(known, eye.ratio ?? 1) : known;
  if (eye.busy || !eye.store || !place || same(place, eye.sent)) return;
  eye.busy = true;
  const [position, look_target, eye_up] = place.map((part) => [part]);
  if (await control(updateBlueprint(eye.store, { [eye.known.eye]: { EyeControls3D: { position, look_target, eye_up } } })))
    eye.sent = place;
  eye.busy = false;
}

// Divides the stage anew where its size, the rows at the image or the run are others. A division that a hand made stays till then.
async function arrange(eye, control) {
  const { layout } = eye.known;
  if (!layout) return;
  const { clientWidth: width, clientHeight: height } = at("viewer");
  const rows = at("at-image").offsetHeight;
  const wanted = JSON.stringify([layout.container, width, height, rows, layout.images]);
  if (eye.arranging || wanted === eye.arranged) return;
  eye.arranging = true;
  eye.division = divided(width, height, rows, layout.images);
  const { world, below, left, top } = eye.division;
  eye.ratio = below ? width / (world * height) : (world * width) / height;
  Object.assign(at("at-image").style, { left: `${left}px`, top: `${top}px` });
  at("captions").style.setProperty("--rows", `${below ? rows : 0}px`); // they lie above the rows
  at("eyes").style.maxWidth = `${(below ? 1 : world) * width - 20}px`;
  if (await control(updateBlueprint(eye.store, asBlueprint(eye.division, layout.container)))) eye.arranged = wanted;
  eye.arranging = false;
}

// Whether a place, as shares of the stage, is in the 3-D view.
const isWorld = ({ division }, x, y) => (division?.below ? y : x) < (division?.world ?? 0);

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

function mark({ mode }) {
  for (const button of at("eyes").querySelectorAll("button")) button.setAttribute("aria-pressed", String(button.dataset.eye === mode));
}

// A hand that turns, shifts or zooms the 3-D view.
function watchHand(canvas, isInside, moved) {
  let pressed = null;
  const inside = ({ clientX, clientY }) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    return isInside((clientX - left) / width, (clientY - top) / height);
  };
  const listen = (kind, act) => canvas.addEventListener(kind, act, { capture: true, passive: true });
  listen("pointerdown", (event) => (pressed = inside(event) ? event : null));
  listen("pointerup", () => (pressed = null));
  listen("pointermove", (event) => {
    if (!pressed || !event.buttons || Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY) < MOVED_PX) return;
    pressed = null;
    moved();
  });
  listen("wheel", (event) => inside(event) && moved());
}
