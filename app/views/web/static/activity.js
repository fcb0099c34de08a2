// What is under way, in words: not before it has taken a while, and then for how long, where it does not say that itself.
const SLOW_MS = 700;
const COUNTED_MS = 2000;

// The activity that follows `before`, at a time in ms: one goes on as long as it began at the same moment, whatever it says.
export function following(before, text, began, now) {
  return { text, began, since: began !== null && began === before?.began ? before.since : now };
}

export function wordsOf({ text, began, since }, now) {
  const waited = now - since;
  if (!text || (waited < SLOW_MS && !text.startsWith("computing"))) return "";
  const counted = waited > COUNTED_MS && began !== null && !text.includes("about ");
  return `${text}${counted ? ` ${Math.round(waited / 1000)} s` : ""}`;
}
