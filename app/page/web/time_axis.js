// The time axis under the bar: where what happened in the run, and where it stands. The server sends each exposure once;
// the picture is drawn when something was added, while it grows once in a while, and at other times only the cursor moves.
import { drawAxis, heightOf, laneAt, PAD } from "./axis_picture.js";

const GROWS_MS = 1000; // between two pictures of a run that goes on: each costs as much as the whole run has marks
const NEAR_PX = 4; // an event so near to the pointer is named
const MOST_EVENTS = 4;
const at = (id) => document.getElementById(id);

export function makeAxis(seek) {
  const strip = at("axis");
  const axis = { times: [], kinds: "", methods: [], computed: 0, matches: [], condition: "", branches: [], bookmarks: [], events: [], loop: null };
  let index = -1;
  let width = strip.clientWidth;
  let due = null;
  const moveCursor = () => (at("cursor").style.left = `${place(axis, width, Math.max(index, 0))}px`);
  const draw = () => {
    clearTimeout(due);
    due = null;
    strip.style.setProperty("--axis", `${heightOf(axis)}px`);
    drawAxis(strip.querySelector("canvas"), width, axis, (i) => place(axis, width, i));
    moveCursor();
  };
  let asked = null;
  const seekTo = ({ clientX }) => {
    const wanted = nearest(axis, strip, clientX);
    if (axis.times.length && wanted !== asked) seek((asked = wanted));
  };
  new ResizeObserver(() => {
    if (width === strip.clientWidth) return;
    width = strip.clientWidth;
    draw();
  }).observe(strip);
  strip.addEventListener("pointerdown", (event) => {
    strip.setPointerCapture(event.pointerId);
    asked = null;
    seekTo(event);
  });
  strip.addEventListener("pointermove", (event) => {
    if (strip.hasPointerCapture(event.pointerId)) seekTo(event);
    hint(axis, strip, event);
  });
  strip.addEventListener("pointerleave", () => (at("axis-hint").hidden = true));

  return {
    data: axis,
    show: (state) => {
      index = state.index;
      const loop = String(axis.loop);
      axis.loop = state.loop;
      if (state.axis) take(axis, state.axis);
      const { results, computed, ...rest } = state.axis ?? {};
      if (Object.keys(rest).length || String(state.loop) !== loop) draw();
      else if (results) due ??= setTimeout(draw, GROWS_MS);
      moveCursor();
    },
  };
}

function take(axis, news) {
  if (news.methods) {
    const methods = news.methods.map((method) => ({ ...method, keyFrames: [], lost: [] }));
    Object.assign(axis, { times: [], kinds: "", methods, computed: 0, matches: [], condition: "", branches: [], bookmarks: [], events: [] });
  }
  axis.times = axis.times.concat(news.times_ms ?? []);
  axis.kinds += news.kinds ?? "";
  axis.computed = news.computed ?? axis.computed;
  (news.results ?? []).forEach(({ key_frames, lost }, i) => {
    const method = axis.methods[i];
    method.keyFrames.push(...key_frames);
    for (const [first, last] of lost) {
      const before = method.lost.at(-1);
      if (before?.[1] === first - 1) before[1] = last;
      else method.lost.push([first, last]);
    }
  });
  if (news.condition !== undefined) Object.assign(axis, { condition: news.condition, matches: [] });
  axis.matches.push(...(news.matches ?? []));
  axis.branches = news.branches ?? axis.branches;
  axis.events.push(...(news.events ?? []));
  axis.bookmarks = news.bookmarks ?? axis.bookmarks;
}

const room = (width) => Math.max(width - 2 * PAD, 1);
const length = ({ times }) => Math.max(times.at(-1) ?? 0, 1);
const place = (axis, width, index) => PAD + (room(width) * (axis.times[Math.min(index, axis.times.length - 1)] ?? 0)) / length(axis);

// The exposure whose time is nearest to a place.
function nearest(axis, strip, clientX) {
  const { times } = axis;
  const time = ((clientX - strip.getBoundingClientRect().left - PAD) / room(strip.clientWidth)) * length(axis);
  let low = 0;
  let high = times.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low > 0 && time - times[low - 1] < times[low] - time ? low - 1 : low;
}

const near = (axis, strip, index, clientX) => Math.abs(place(axis, strip.clientWidth, index) - clientX + strip.getBoundingClientRect().left) <= NEAR_PX;

function hint(axis, strip, { clientX, clientY }) {
  const box = at("axis-hint");
  box.hidden = !axis.times.length;
  if (box.hidden) return;
  const index = nearest(axis, strip, clientX);
  box.textContent = [
    laneAt(axis, clientY - strip.getBoundingClientRect().top),
    `exposure ${index} · ${(axis.times[index] / 1000).toFixed(2)} s · ${axis.kinds[index] === "s" ? "stereo" : "video"}`,
    index >= axis.computed ? "not computed yet" : "",
    ...axis.methods.map((method) => happened(method, index)),
    ...axis.events.filter(({ at }) => near(axis, strip, at, clientX)).slice(0, MOST_EVENTS).map(({ at, text }) => `${at}: ${text}`),
    axis.matches.includes(index) ? `holds: ${axis.condition}` : "",
    ...axis.branches.filter((branch) => branch.at === index).map((branch) => `${branch.name} begins`),
    ...axis.bookmarks.filter((bookmark) => bookmark.at === index).map(({ note }) => `bookmark${note && `: ${note}`}`),
  ].filter(Boolean).join("\n");
  box.style.left = `${Math.min(Math.max(clientX - box.offsetWidth / 2, 4), innerWidth - box.offsetWidth - 4)}px`;
}

function happened({ label, keyFrames, lost }, index) {
  const what = [keyFrames.includes(index) && "key frame", lost.some(([first, last]) => first <= index && index <= last) && "lost"];
  return what.some(Boolean) ? `${label}: ${what.filter(Boolean).join(", ")}` : "";
}
