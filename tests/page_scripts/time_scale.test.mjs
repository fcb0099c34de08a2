import assert from "node:assert/strict";
import { test } from "node:test";
import { apart, GUTTER, labelledFrames, nearestFrame, PAD, placeOf } from "../../app/views/web/static/time_scale.js";

const WIDTH = 1000;
const TIMES = [0, 33, 66, 100, 500, 533]; // with a gap

test("the first and the last frame are at the ends of the axis", () => {
  assert.equal(placeOf(TIMES, WIDTH, 0), GUTTER);
  assert.equal(placeOf(TIMES, WIDTH, 5), WIDTH - PAD);
  assert.equal(placeOf(TIMES, WIDTH, 99), WIDTH - PAD);
});

test("the frame nearest to the place of a frame is that frame", () => {
  TIMES.forEach((_, index) => assert.equal(nearestFrame(TIMES, WIDTH, placeOf(TIMES, WIDTH, index)), index));
});

test("between two frames the nearer one is chosen, and outside the first or the last", () => {
  const [third, fourth] = [placeOf(TIMES, WIDTH, 3), placeOf(TIMES, WIDTH, 4)];
  assert.equal(nearestFrame(TIMES, WIDTH, 0.6 * third + 0.4 * fourth), 3);
  assert.equal(nearestFrame(TIMES, WIDTH, 0.4 * third + 0.6 * fourth), 4);
  assert.equal(nearestFrame(TIMES, WIDTH, -50), 0);
  assert.equal(nearestFrame(TIMES, WIDTH, 2 * WIDTH), 5);
});

test("a run without frames, or with one, has places too", () => {
  assert.equal(nearestFrame([], WIDTH, 300), 0);
  assert.equal(placeOf([], WIDTH, 0), GUTTER);
  assert.equal(nearestFrame([0], WIDTH, 300), 0);
});

test("labels are round numbers, and no more than there is room for", () => {
  assert.deepEqual(labelledFrames(44, 10), [0, 5, 10, 15, 20, 25, 30, 35, 40]);
  assert.deepEqual(labelledFrames(3, 10), [0, 1, 2]);
  for (const count of [1, 7, 99, 101, 661, 5000, 123456]) assert.ok(labelledFrames(count, 12).length <= 12);
});

test("numbers of frames of one time do not stand on each other", () => {
  const times = [0, 0, 100, 100, 200, 200];
  const place = (index) => placeOf(times, WIDTH, index);
  assert.deepEqual(apart([0, 1, 2, 3, 4, 5], place, 30), [0, 2, 4]);
  assert.deepEqual(
    apart([0, 1], () => 7, 30),
    [0],
  );
});
