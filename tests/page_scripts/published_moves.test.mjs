// What the commands of a published page do to its state.
import assert from "node:assert/strict";
import { test } from "node:test";
import { commandsOf } from "../../app/views/web/static/published_moves.js";

const data = {
  plots: { usual: ["error"], rows: { error: {}, alive: {}, "stereo.inliers": {} } },
  paths: { tracks: ["a"], clouds: ["b"] },
  comparisons: [{ numbers: [0, 1], branches: { 0: "live:0", 1: "live:1" } }],
};
const state = { index: 3, playing: false, loop: null, plots: ["error"], source: "06", compared: [0, 1, 10, true] };
const after = (message, before = state) => commandsOf[message.do](message, before, data);

test("a place is taken as the page has it", () => {
  assert.deepEqual(after({ do: "look_at", index: 7, playing: true, loop: [2, 8] }), { index: 7, playing: true, loop: [2, 8] });
});

test("plots and layers are those that the run has", () => {
  assert.deepEqual(after({ do: "plot", name: "alive" }), { plots: ["error", "alive"] });
  assert.deepEqual(after({ do: "plot", name: "error" }), { plots: [] });
  assert.match(after({ do: "plot", name: "nothing" }), /no quantity/);
  assert.deepEqual(after({ do: "set_plots", names: null }), { plots: ["error"] });
  assert.deepEqual(after({ do: "set_plots", names: ["alive", "x"] }), { plots: ["alive"] });
  assert.deepEqual(after({ do: "hide", names: ["tracks", "x"] }), { hidden: ["tracks"] });
});

test("another run and another comparison are refused", () => {
  assert.deepEqual(after({ do: "open_named", name: "06" }), {});
  assert.match(after({ do: "open_named", name: "07" }), /06/);
  assert.deepEqual(after({ do: "compare_runs", a: "live:0", b: "live:1" }), { compared: [0, 1, 10, true] });
  assert.match(after({ do: "compare_runs", a: "live:1", b: "live:0" }), /first/);
});
