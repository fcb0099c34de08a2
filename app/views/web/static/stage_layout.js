// How the stage is divided: the image gets the room that its shape needs, and the rows of the page at the image stand right
// below it. The image is right of the 3-D view, or below it where it is nearly as large or larger there.
const HEAD = 24; // pixels of a view's title
const LEAST = 0.4; // of the stage for the image
const MOST = 0.66;
const NEARLY = 0.9;
const HORIZONTAL = 2; // rerun.blueprint.components.ContainerKind
const VERTICAL = 3;

const within = (value) => Math.min(Math.max(value, LEAST), MOST);

// `width` and `height` of the stage and `rows` of what stands below the image [pixels]; `images` by path of their views have
// their sizes, and the first one decides. Gives the share `world` of the 3-D view, whether the image is `below` it, where
// the rows begin [pixels], and the bounds of each view in its image's coordinates: `x` and `y`, [low, high].
export function divided(width, height, rows, images) {
  const [first] = Object.values(images);
  if (!first) return { world: 1, below: false, left: 0, top: height, bounds: {} };
  const aspect = first[0] / first[1];
  const ways = [
    [within(((height - HEAD - rows) * aspect) / width), false],
    [within((HEAD + width / aspect + rows) / height), true],
  ].map(([image, below]) => {
    const [wide, tall] = below ? [width, image * height - HEAD] : [image * width, height - HEAD];
    const scaleOf = ([w, h]) => Math.min(wide / w, Math.max(tall - rows, 1) / h);
    return { image, below, wide, tall, scaleOf };
  });
  const { image, below, wide, tall, scaleOf } = ways[Number(ways[1].scaleOf(first) > NEARLY * ways[0].scaleOf(first))];
  const boundsOf = ([w, h]) => {
    const scale = scaleOf([w, h]);
    return { x: [(w - wide / scale) / 2, (w + wide / scale) / 2], y: [0, tall / scale] };
  };
  return {
    world: 1 - image,
    below,
    left: width - wide,
    top: (below ? (1 - image) * height : 0) + HEAD + scaleOf(first) * first[1],
    bounds: Object.fromEntries(Object.entries(images).map(([view, size]) => [view, boundsOf(size)])),
  };
}

// The same as components of the viewer's layout.
export function asBlueprint({ world, below, bounds }, container) {
  const shares = [world, 1 - world];
  const views = Object.entries(bounds).map(([view, { x, y }]) => [
    `${view}/VisualBounds2D`,
    { VisualBounds2D: { range: [{ x_range: x, y_range: y }] } },
  ]);
  const kind = below ? { container_kind: [VERTICAL], row_shares: shares } : { container_kind: [HORIZONTAL], col_shares: shares };
  return { [container]: { ContainerBlueprint: kind }, ...Object.fromEntries(views) };
}

// An eye that has all in sight in a view as wide as high, moved back where the view is narrower.
export function withinWidth([position, target, up], ratio) {
  const back = Math.max(1, 1 / ratio);
  return [position.map((value, i) => target[i] + (value - target[i]) * back), target, up];
}
