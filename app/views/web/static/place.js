// @ts-check
// A page's own place in a run: the frame that it shows, whether and how fast it plays, and its loop. A page that looks around
// while somebody else is in control has one, and a published page: they differ by where the frames come from.

/**
 * What is known of a run: the times of its frames [ms], their kinds as letters, its keyframes, the frames with an event or a
 * bookmark, the number of computed frames, and whether more are being computed.
 * @typedef {{ times: number[], kinds: string, keyFrames: number[], events: { at: number, severity: string }[], computed: number, goesOn: boolean }} Facts
 * @typedef {[number, number | null] | null} Loop
 * @typedef {{ index: number, playing: boolean, loop: Loop, speed: number | null }} Place
 * @typedef {{ do: string, on?: boolean | null, count?: number, index?: number, kind?: string, forwards?: boolean, alarming?: boolean, factor?: number | null, edge?: string, start?: number, end?: number | null }} Message
 */

const MOST_HZ = 60; // frames a second of "as fast as possible"
const ALARMING = ["warning", "lost"];
const NOTHING_YET = "There is no frame to look at yet: wait for the first one.";

/**
 * By command: what it changes in a place, or a sentence that says why it changes nothing.
 * @type {Record<string, (message: Message, place: Place, facts: Facts) => Partial<Place> | string>}
 */
export const moves = {
  play: ({ on = null }, { index, playing, loop }, { computed }) => {
    const goesOn = on ?? !playing;
    const last = Math.min(loop?.[1] ?? Infinity, computed - 1);
    return { playing: goesOn, index: goesOn && index >= last ? (loop?.[0] ?? 0) : index };
  },
  step_by: ({ count = 0 }, { index }, facts) => show(index + count, facts),
  seek: ({ index = 0 }, _, facts) => show(index, facts),
  go_to_end: (_, __, facts) => show(facts.computed - 1, facts),
  step_to: ({ kind, forwards = true }, { index }, facts) => {
    const stereo = [...facts.kinds].flatMap((each, i) => (each === "s" ? [i] : []));
    const at = nearest(kind === "stereo" ? stereo : facts.keyFrames, index, forwards);
    const missing = `There is no ${kind === "stereo" ? "stereo frame" : "keyframe"} ${forwards ? "after" : "before"} frame ${index}.`;
    return found(at, missing, facts);
  },
  step_to_event: ({ forwards = true, alarming = false }, { index }, facts) => {
    const frames = facts.events.filter(({ severity }) => !alarming || ALARMING.includes(severity)).map(({ at }) => at);
    const missing = `No ${alarming ? "problem" : "event"} ${forwards ? "after" : "before"} frame ${index}.`;
    return found(nearest(frames, index, forwards), missing, facts);
  },
  speed: ({ factor = null }) => ({ speed: factor }),
  no_loop: () => ({ loop: null }),
  // An edge on the wrong side of the other one begins another loop.
  loop_edge: ({ edge }, { index, loop }, { computed }) => {
    const [before, after] = loop ?? [0, null];
    /** @type {[number, number | null]} */
    const wanted = edge === "start" ? [index, after !== null && after > index ? after : null] : [before < index ? before : 0, index];
    return wanted[0] < (wanted[1] ?? computed - 1) ? { loop: wanted } : `A loop needs two frames: frame ${index} cannot be its ${edge}.`;
  },
  set_loop: ({ start = 0, end = null }, _, { computed }) => {
    const last = Math.min(end ?? Infinity, computed - 1);
    const first = Math.max(start, 0);
    return first < last
      ? { loop: [first, end === null ? null : last] }
      : `A loop needs two frames: it cannot go from frame ${start} to ${end ?? last}.`;
  },
};

/** @param {number} index @param {Facts} facts */
const show = (index, { computed }) => ({ index: Math.min(Math.max(index, 0), computed - 1), playing: false });

/** @param {number | undefined} at @param {string} missing @param {Facts} facts */
function found(at, missing, facts) {
  if (at === undefined) return missing;
  return at < facts.computed ? show(at, facts) : `${missing.slice(0, -1)} among the frames that are computed.`;
}

/** @param {number[]} frames @param {number} index @param {boolean} forwards */
function nearest(frames, index, forwards) {
  const there = frames.filter((frame) => (forwards ? frame > index : frame < index));
  if (there.length) return forwards ? Math.min(...there) : Math.max(...there);
}

/**
 * The place after so much playing [ms] from frame `began` on.
 * @param {Place} place @param {number} began @param {number} elapsed @param {Facts} facts
 * @returns {Place & { restarts: boolean }} `restarts`: the time counts from this place on
 */
export function played(place, began, elapsed, { times, computed, goesOn }) {
  const { loop, speed } = place;
  const first = loop?.[0] ?? 0;
  const last = Math.min(loop?.[1] ?? Infinity, computed - 1);
  let index = began;
  if (speed === null) index += Math.floor((elapsed * MOST_HZ) / 1000);
  else while (index < last && times[index + 1] - times[began] <= elapsed * speed) index++;
  if (index < last) return { ...place, index, restarts: false };
  // A looping place shows its last frame once before it goes round; one that waits for frames stays.
  if (loop && place.index >= last) return { ...place, index: first, restarts: true };
  return { ...place, index: last, playing: Boolean(loop) || goesOn, restarts: true };
}

/**
 * Keeps a place: `at` what of it is the page's own, `facts` what is known now, `shared` the place of the session, and `changed`
 * is called with what is the page's own then.
 * @param {{ facts: () => Facts, shared: () => Place, changed: (own: Partial<Place>) => void, now?: () => number }} page
 */
export function makePlace({ facts, shared, changed, now = () => performance.now() }) {
  /** @type {Partial<Place>} */
  let own = {};
  let began = { at: 0, index: 0 };
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;

  const here = () => ({ ...shared(), ...own });

  function begin() {
    began = { at: now(), index: here().index };
    clearTimeout(timer);
    if (own.playing) timer = setTimeout(turn, 1000 / MOST_HZ);
  }

  // Goes on with the playback, within the frames that are computed.
  function turn() {
    const before = here();
    const { restarts, index, playing } = played(before, began.index, now() - began.at, facts());
    Object.assign(own, { index, playing });
    if (restarts || !playing) begin();
    else timer = setTimeout(turn, 1000 / MOST_HZ);
    if (index !== before.index || !playing) changed(own);
  }

  return {
    /** @param {Message} message @returns {string} why nothing changes; empty where something does */
    obey(message) {
      const known = facts();
      const change = known.computed ? moves[message.do](message, here(), known) : NOTHING_YET;
      if (typeof change === "string") return change;
      Object.assign(own, change);
      begin();
      changed(own);
      return "";
    },
    /** From now on the page shows what the session shows. */
    leave() {
      own = {};
      clearTimeout(timer);
    },
    turn,
  };
}
