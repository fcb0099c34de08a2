import assert from "node:assert/strict";
import { test } from "node:test";
import { asBlueprint, divided, withinWidth } from "../../app/views/web/static/stage_layout.js";

const ROWS = 24;
const TITLE = 24;
const of = (width, height) => ({ "/view/v": [width, height] });
const near = (value, wanted) => assert.ok(Math.abs(value - wanted) < 1, `${value}, not ${wanted}`);

test("an image of 4:3 fills its view down to the rows below it", () => {
  const found = divided(1213, 640, ROWS, of(640, 480));
  const { x, y } = found.bounds["/view/v"];
  near(found.top + ROWS, 640);
  near(x[0], 0);
  near(x[1], 640);
  assert.ok(y[0] === 0 && !found.below && found.world < 0.4);
  near(found.left, found.world * 1213);
});

test("the 3-D view keeps a third where an image could take all, and the image has the whole width of its view then", () => {
  const found = divided(893, 500, ROWS, of(1280, 720));
  near(100 * found.world, 34);
  assert.deepEqual(found.bounds["/view/v"].x, [0, 1280]);
  near(found.top, TITLE + (0.66 * 893 * 720) / 1280);
});

test("a wide image has the whole width, below the 3-D view", () => {
  const found = divided(1213, 640, ROWS, of(1242, 375));
  assert.ok(found.below && found.left === 0);
  near(found.top + ROWS, 640);
  const sent = asBlueprint(found, "/container/1");
  assert.deepEqual(sent["/container/1"].ContainerBlueprint, { container_kind: [3], row_shares: [found.world, 1 - found.world] });
  assert.deepEqual(Object.keys(sent["/view/v/VisualBounds2D"].VisualBounds2D.range[0]), ["x_range", "y_range"]);
});

test("in a narrow window the image is below", () => assert.ok(divided(760, 617, ROWS, of(640, 480)).below));

test("without an image the 3-D view has all", () => assert.equal(divided(1000, 500, 0, {}).world, 1));

test("an eye goes back where the view is narrow", () => {
  const [position, target] = withinWidth(
    [
      [0, 0, -2],
      [0, 0, 2],
      [0, -1, 0],
    ],
    0.5,
  );
  assert.deepEqual(
    [position, target],
    [
      [0, 0, -6],
      [0, 0, 2],
    ],
  );
  assert.deepEqual(
    withinWidth(
      [
        [1, 2, 3],
        [0, 0, 0],
        [0, -1, 0],
      ],
      2,
    )[0],
    [1, 2, 3],
  );
});
