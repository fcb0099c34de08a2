// Where a frame is on the time dock, and which frame is at a place. Times are linear; the labels of the rows are left of
// them, and the values of the plots right.
export const GUTTER = 176;
export const PAD = 200;

const room = (width) => Math.max(width - GUTTER - PAD, 1);
const duration = (times) => Math.max(times.at(-1) ?? 0, 1);

// Pixels from the dock's left edge; frames beyond the last one are at the end.
export const placeOf = (times, width, index) => GUTTER + (room(width) * (times[Math.min(index, times.length - 1)] ?? 0)) / duration(times);

// The frame whose time is nearest to a place [pixels].
export function nearestFrame(times, width, x) {
  const time = ((x - GUTTER) / room(width)) * duration(times);
  let low = 0;
  let high = Math.max(times.length - 1, 0);
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low > 0 && time - times[low - 1] < times[low] - time ? low - 1 : low;
}

// Frames to label: multiples of 1, 2 or 5 times a power of ten; at most `most`.
export function labelledFrames(count, most) {
  const least = Math.max(count / Math.max(most, 1), 1);
  const power = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((each) => each >= least);
  return Array.from({ length: Math.ceil(count / step) }, (_, i) => i * step);
}

// Of frames in order those whose places [pixels] are so far from the one before: images of a pair, say, are of one time.
export function apart(frames, place, least) {
  let last = -Infinity;
  return frames.filter((index) => {
    const far = place(index) - last >= least;
    if (far) last = place(index);
    return far;
  });
}
