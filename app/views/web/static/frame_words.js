// What the page says of the frame shown: how many images there were up to it, and what the views show of it.
const IMAGES = { v: "video", s: "stereo", c: "cameras" };

// "video 51 of 51, stereo 11 of 11": frames of the clocks that have images, where there are several kinds of frames. The
// frame's number counts all of them, and what is measured between.
export function imagesUpTo(kinds, index) {
  const counts = {};
  for (let i = 0; i < kinds.length; i++) {
    counts[kinds[i]] ??= [0, 0];
    counts[kinds[i]][0] += i <= index;
    counts[kinds[i]][1] += 1;
  }
  if (Object.keys(counts).length < 2) return "";
  const shown = Object.keys(IMAGES).filter((kind) => counts[kind]);
  return shown.map((kind) => `${IMAGES[kind]} ${counts[kind][0]} of ${counts[kind][1]}`).join(", ");
}

// Of the views, as `viewer.drawn` has them: what they show where that is not the frame of the page; empty where it is. What
// comes is on the views in part or whole, until the viewer says that it has taken it in.
export function lateness({ shown, wanted, coming, other }) {
  if (other) return "loading this run: the views still show the one before";
  if (!shown) return "";
  const loading = shown.index === wanted ? coming : wanted;
  if (coming !== shown.index) return `loading frame ${loading}: the views show ${shown.index} or already ${coming}`;
  if (loading !== shown.index) return `loading frame ${loading}: the views show ${shown.index}`;
  return shown.complete ? "" : `loading the images of frame ${wanted}`;
}
