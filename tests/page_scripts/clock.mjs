// A clock that tests set: timers and performance.now go by it, and nothing waits.
let now = 0;
let timers = [];
let count = 0;

globalThis.setTimeout = (call, ms = 0) => {
  timers.push({ id: ++count, at: now + ms, call });
  return count;
};
globalThis.clearTimeout = (id) => {
  timers = timers.filter((timer) => timer.id !== id);
};
Object.defineProperty(globalThis, "performance", { value: { now: () => now, getEntriesByType: () => [] } });

// Lets promises go on that wait for nothing but each other.
export const settle = () => new Promise(setImmediate);

export async function advance(ms) {
  const end = now + ms;
  await settle();
  for (;;) {
    const [next] = timers.filter(({ at }) => at <= end).sort((a, b) => a.at - b.at || a.id - b.id);
    if (!next) break;
    clearTimeout(next.id);
    now = Math.max(now, next.at);
    next.call();
    await settle();
  }
  now = end;
}
