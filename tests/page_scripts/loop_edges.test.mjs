import assert from "node:assert/strict";
import { test } from "node:test";
import { moved } from "../../app/views/web/static/loop_edges.js";

test("an edge goes with the hand, and stays beside the other one and within the run", () => {
  assert.deepEqual(moved([10, 20], "start", 4, 44), [14, 20]);
  assert.deepEqual(moved([10, 20], "start", 40, 44), [19, 20]);
  assert.deepEqual(moved([10, 20], "start", -40, 44), [0, 20]);
  assert.deepEqual(moved([10, 20], "end", -40, 44), [10, 11]);
  assert.deepEqual(moved([10, 20], "end", 40, 44), [10, 43]);
});

test("a loop that is moved keeps its length", () => {
  assert.deepEqual(moved([10, 20], "both", 5, 44), [15, 25]);
  assert.deepEqual(moved([10, 20], "both", -50, 44), [0, 10]);
  assert.deepEqual(moved([10, 20], "both", 50, 44), [33, 43]);
});
