// How often the Rerun viewer draws. It would draw without end, though nothing moves, and where graphics are software a
// frame takes as long as a frame's computation. So it draws freely only for a moment after something happened: data
// came, a hand is on it, our time moved. After that less and less often; and a slow frame leaves others as much time again,
// unless a hand waits for it. Rerun takes in its stream as it draws: it goes on drawing until that is done.
const FREE_MS = 700;
const SLOW_MS = 40;
const FIRST_MS = 40;
const RAREST_MS = 30_000;

const frame = window.requestAnimationFrame.bind(window);
let wokenAt = 0;
let handAt = -FREE_MS;
let idle = FIRST_MS; // the pause before the next frame while nothing happens
let took = 0;
let unread = 0; // messages that the viewer has not taken in
let hurried = false; // whether somebody waits for them
let partial = false; // whether the last frame took in a part of them
let waiting = null;
let drawn = () => {}; // called after each frame
let looking = []; // who wants to see a frame

window.requestAnimationFrame = (callback) => {
  const now = performance.now();
  const awake = now - wokenAt < FREE_MS || unread > 0;
  const rest = took > SLOW_MS && !((hurried || partial) && unread > 0) && now - handAt > FREE_MS ? Math.min(took, FREE_MS) : 0;
  if (!awake) idle = Math.min(3 * idle, RAREST_MS);
  const go = () => {
    waiting = null;
    const asked = performance.now();
    frame((now) => {
      took = performance.now() - asked;
      callback(now);
      looking = looking.filter((look) => !look());
      if (unread > 0) drawn();
      partial = unread > 0;
    });
  };
  const pause = awake ? rest : idle;
  if (pause > 0) waiting = { go, timer: setTimeout(go, pause) };
  else go();
  return 0; // nobody cancels
};

// Something happened that the viewer shall show; at once where it was a hand.
export function wake(hand = false) {
  const now = performance.now();
  const sleeps = now - wokenAt > FREE_MS;
  wokenAt = now;
  if (hand) handAt = now;
  idle = FIRST_MS;
  if (!waiting || !(sleeps || hand)) return;
  clearTimeout(waiting.timer);
  waiting.go();
}

// Calls `look` right after each frame, the only time at which its picture can be read, until it says that it saw enough.
export function afterFrames(look) {
  looking.push(look);
  wake(true);
}

// So many messages were given to the viewer that it has not taken in yet.
export function expectData(count) {
  if (count > unread) wake();
  unread = count;
}

// Whether somebody waits for what the viewer takes in: then no frame waits.
export function hurry(now) {
  if (now && !hurried && unread > 0) wake();
  hurried = now;
}

// Calls this after each frame that may have taken in something.
export function afterData(look) {
  drawn = look;
}
