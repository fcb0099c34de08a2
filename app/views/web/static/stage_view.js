// The eye of Rerun's 3-D view: it frames the path until a person moves it, or goes where one of the buttons says. The
// server says where that is (app/features/stage/page_message.py).
import { updateBlueprint } from "./viewer_control.js";

const MOVED_PX = 4; // a press that moves less is a click
const at = (id) => document.getElementById(id);
let frame = () => false;

// The key f.
export const frameAgain = () => frame();

// `control` sends a message to the viewer, and returns whether the viewer took it.
export function makeEye(canvas, control) {
  const eye = { mode: "frame", known: {}, sent: null, busy: false };
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
    () => eye.known.share,
    () => {
      eye.mode = null;
      mark(eye);
    },
  );
  mark(eye);
  return {
    // What is new of the places, if anything; `store` is the recording that the viewer shows.
    follow: (news) => {
      if (news?.eye) Object.assign(eye, { known: {}, sent: null }); // another run has another layout
      Object.assign(eye.known, news ?? {});
    },
    show: (store) => {
      if (store !== eye.store) {
        Object.assign(eye, { store, sent: null });
        hideCurves(eye, control);
      }
      push(eye, control);
    },
  };
}

// One request at a time, and none for a place where the eye was put already.
async function push(eye, control) {
  const place = eye.known[eye.mode];
  if (eye.busy || !eye.store || !place || same(place, eye.sent)) return;
  eye.busy = true;
  const [position, look_target, eye_up] = place.map((part) => [part]);
  if (await control(updateBlueprint(eye.store, { [eye.known.eye]: { EyeControls3D: { position, look_target, eye_up } } })))
    eye.sent = place;
  eye.busy = false;
}

// A recording's own layout has curves and decisions for a viewer without the page.
function hideCurves({ store, known: { curves } }, control) {
  if (curves) control(updateBlueprint(store, { [curves]: { ContainerBlueprint: { visible: [false] } } }));
}

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

function mark({ mode }) {
  for (const button of at("eyes").querySelectorAll("button")) button.setAttribute("aria-pressed", String(button.dataset.eye === mode));
}

// A hand that turns, shifts or zooms the 3-D view, which has the left part of the canvas.
function watchHand(canvas, share, moved) {
  let pressed = null;
  const inside = ({ clientX }) => {
    const { left, width } = canvas.getBoundingClientRect();
    return clientX - left < width * (share() ?? 0);
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
