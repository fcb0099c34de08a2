// Numbers for people, with units that adapt to their size: 0.28 mm, 19.7 mm, 1.2 km; 14 ms.
const SCALES = {
  m: [
    [1000, "km", 1e-3],
    [1, "m", 1],
    [0, "mm", 1e3],
  ],
  s: [
    [1, "s", 1],
    [0, "ms", 1e3],
  ],
};

// The unit in which values up to `size` are shown, and the factor to it.
export function shownUnit(unit, size) {
  const [, name, factor] = SCALES[unit]?.find(([least]) => Math.abs(size) >= least) ?? [0, unit, 1];
  return { name, factor };
}

// Three significant digits, or all digits before the point.
export function digits(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1000) return value.toFixed(0);
  if (size !== 0 && size < 1e-3) return value.toPrecision(2);
  return String(Number(value.toPrecision(3)));
}
