// The two time cursors: ours sets Rerun's, and a hand in Rerun's plots sets ours. Rerun tells of every change of its cursor,
// up to half a second late, and not who made it. A change is the person's only where a touch of the canvas is newer than all
// that we asked for, and the change is nothing that we asked for.
import { wake } from "./render_throttle.js";
import { setTimeCursor, TIMELINE } from "./viewer_control.js";

const HAND_MS = 3000; // how long after a touch of the canvas a change of time may be the person's
const HELD_MS = 500; // how long a press keeps our requests back
const SETTLE_MS = 60; // a hand that drags chooses that often
const LATE = 8; // requests whose answers may still come

export function makeCursor(canvas, seek, control) {
  const cursor = { wanted: null, sent: null, asked: [], busy: false, seen: null, store: null, seek, control };
  forget(cursor);
  for (const kind of ["pointerdown", "pointerup", "pointermove", "wheel", "keydown"]) {
    canvas.addEventListener(kind, (event) => touched(cursor, event), { capture: true, passive: true });
  }
  return Object.assign(cursor, {
    show: (recording, index) => show(cursor, recording, index),
    heard: (event) => heard(cursor, event),
    release: () => release(cursor),
    again: (index) => {
      cursor.sent = null;
      cursor.wanted = index;
      push(cursor);
    },
  });
}

// `recording` is what Rerun shows now: where that is not what it was asked for last, it is asked again.
function show(cursor, recording, index) {
  if (recording.id !== cursor.store) Object.assign(cursor, { store: recording.id, sent: null, asked: [] });
  if (cursor.chosen !== null) return;
  const agrees = recording.paused && recording.timeline === TIMELINE && recording.time === cursor.sent;
  const undisturbed = !cursor.busy && performance.now() - cursor.touchedAt > HAND_MS;
  if (!agrees && undisturbed) cursor.sent = null;
  cursor.wanted = index;
  push(cursor);
}

// One request at a time, and only the latest: an answer can take a quarter of a second in software rendering. Where a hand
// has just come down, Rerun is left alone: what it tells next is where the hand went.
async function push(cursor) {
  if (cursor.busy) return;
  cursor.busy = true;
  while (cursor.wanted !== cursor.sent) {
    const held = cursor.pressedAt + HELD_MS - performance.now();
    if (held > 0) await wait(held);
    else if (!(await ask(cursor, cursor.wanted))) break; // asked again with the next state
  }
  cursor.busy = false;
}

async function ask(cursor, wanted) {
  forget(cursor);
  cursor.asked = [...cursor.asked, wanted].slice(-LATE);
  const done = await cursor.control(setTimeCursor(cursor.store, TIMELINE, wanted));
  if (done) cursor.sent = wanted;
  return done;
}

const wait = (ms) => new Promise((done) => setTimeout(done, ms));

function touched(cursor, event) {
  wake(true);
  if (event.type === "pointermove" && !event.buttons) return;
  cursor.touchedAt = performance.now();
  if (event.type === "pointerdown") cursor.pressedAt = cursor.touchedAt;
}

function forget(cursor) {
  Object.assign(cursor, { touchedAt: -Infinity, pressedAt: -Infinity, chosen: null });
}

// The person goes on elsewhere on the page: where the hand went is said first, and nothing later counts as the hand's.
function release(cursor) {
  if (cursor.chosen !== null) choose(cursor);
  forget(cursor);
}

// Rerun -> ours, when a person did it.
function heard(cursor, event) {
  if (event.type !== "time_update") return;
  wake();
  const index = (cursor.seen = Math.round(event.time));
  if (answers(cursor, index) || index === cursor.sent) return;
  if (performance.now() - cursor.touchedAt > HAND_MS) return;
  if (cursor.chosen === null) setTimeout(() => cursor.chosen !== null && choose(cursor), SETTLE_MS);
  cursor.chosen = cursor.sent = cursor.wanted = index;
}

function choose(cursor) {
  const index = cursor.chosen;
  cursor.chosen = null;
  cursor.seek(index);
}

// Whether we asked for this; what was asked for before it is answered as well.
function answers(cursor, index) {
  const at = cursor.asked.indexOf(index);
  cursor.asked.splice(0, at + 1);
  return at >= 0;
}
