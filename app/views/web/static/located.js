// The share of the frames of each method at which it tracked, in words.
const percent = (share) => `${Math.floor(share * 1000) / 10} %`;

// The share of frames located, of each method; one text where all have the same.
export function locatedTexts({ located, kind }) {
  const from = kind === "sweep" || kind === "experiment" ? "from " : "";
  const shares = new Set(located.map(([, share]) => percent(share)));
  if (!located.length) return ["–"];
  return shares.size === 1 ? [`${from}${[...shares][0]}`] : located.map(([label, share]) => `${label} ${from}${percent(share)}`);
}
