import assert from "node:assert/strict";
import { test } from "node:test";
import { rangeOf, valueAt } from "../../app/views/web/static/quantity_plots.js";

const curve = (values, threshold = false) => ({ values, threshold });

test("a curve has its latest value up to a frame", () => {
  const steps = { frames: [2, 5, 9], values: [20, 50, 90] };
  assert.deepEqual(
    [2, 4, 5, 8, 100].map((index) => valueAt(steps, index)),
    [20, 20, 50, 50, 90],
  );
  assert.ok(Number.isNaN(valueAt(steps, 1)));
  assert.ok(Number.isNaN(valueAt(undefined, 1)));
});

test("the range holds all values, and 0 where that is near", () => {
  assert.deepEqual(rangeOf([curve([3, NaN, 9]), curve([4])], false), [0, 9]);
  assert.deepEqual(rangeOf([curve([8, 9])], false), [8, 9]);
  assert.deepEqual(rangeOf([curve([-2, 9])], false), [-2, 9]);
});

test("a threshold is in the range unless it is far away", () => {
  assert.deepEqual(rangeOf([curve([8, 9]), curve([20], true)], false), [0, 20]);
  assert.deepEqual(rangeOf([curve([8, 9]), curve([2000], true)], false), [8, 9]);
});

test("without values there is no range, and on a logarithmic scale only positive ones count", () => {
  assert.equal(rangeOf([curve([NaN])], false), null);
  assert.equal(rangeOf([curve([0, -1])], true), null);
  assert.deepEqual(rangeOf([curve([0, 0.01, 3])], true), [0.01, 3]);
});
