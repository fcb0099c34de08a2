// How often the Rerun viewer draws. It would draw without end, though nothing moves, and where graphics are software a
// frame takes as long as an exposure's computation. So it draws freely only for a moment after something happened: data
// came, a hand is on it, our time moved. After that less and less often; and a slow frame leaves others as much time again,
// unless a hand waits for it. Rerun takes in only so much of its stream per frame: it goes on drawing until that is done.
const FREE_MS = 700;
const SLOW_MS = 40;
const FIRST_MS = 40;
const RAREST_MS = 30_000;
const FRAME_BYTES = 1_000_000; // that a frame takes in at least, measured with software graphics
const MANY = 5; // frames behind the stream, from which on no frame waits

const frame = window.requestAnimationFrame.bind(window);
let wokenAt = 0;
let handAt = -FREE_MS;
let idle = FIRST_MS; // the pause before the next frame while nothing happens
let took = 0;
let behind = 0; // frames until all that came is taken in
let late = false; // whether the viewer misses exposures that there are
let waiting = null;
const hungry = []; // who waits until the viewer can take more
let looking = []; // who wants to see a frame

window.requestAnimationFrame = (callback) => {
  const now = performance.now();
  const awake = now - wokenAt < FREE_MS || behind > 0 || late;
  const rest = took > SLOW_MS && behind < MANY && !late && now - handAt > FREE_MS ? Math.min(took, FREE_MS) : 0;
  if (!awake) idle = Math.min(3 * idle, RAREST_MS);
  const go = () => {
    waiting = null;
    const asked = performance.now();
    frame((now) => {
      took = performance.now() - asked;
      behind = Math.max(0, behind - 1);
      callback(now);
      looking = looking.filter((look) => !look());
      if (behind < MANY) for (const done of hungry.splice(0)) done();
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

// Whether the viewer still has to take in exposures: it does so as it draws.
export function beBehind(now) {
  if (now && !late) wake();
  late = now;
}

// The viewer was given that much of its stream; resolves when it has taken in so much that it can take more.
// `slower` times as many frames pass as it takes.
export function fed(bytes, slower = 1) {
  behind += (slower * bytes) / FRAME_BYTES;
  wake();
  return new Promise((done) => hungry.push(done));
}
