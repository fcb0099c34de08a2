// What the commands of a published page do to its state.
import assert from "node:assert/strict";
import { test } from "node:test";
import { commandsOf } from "../../app/views/web/static/published_moves.js";

const data = {
  frames: Array.from({ length: 10 }, (_, index) => ({ index })),
  axis: {
    kinds: "svsvsvsvsv",
    results: [{ key_frames: [0, 4] }, { key_frames: [7] }],
    events: [
      { at: 2, severity: "ok" },
      { at: 5, severity: "lost" },
      { at: 8, severity: "warning" },
    ],
    marks: { bookmarks: { sign: "diamond", marks: [{ at: 6, note: "" }] } },
  },
  plots: { usual: ["error"], rows: { error: {}, alive: {}, "stereo.inliers": {} } },
  paths: { tracks: ["a"], clouds: ["b"] },
  comparisons: [{ numbers: [0, 1], branches: { 0: "live:0", 1: "live:1" } }],
};
const state = { index: 3, playing: false, loop: null, plots: ["error"], source: "06", compared: [0, 1, 10, true] };
const after = (message, before = state) => commandsOf[message.do](message, before, data);

test("moves stay within the frames and stop playing", () => {
  assert.deepEqual(after({ do: "step_by", count: 1 }), { index: 4, playing: false });
  assert.deepEqual(after({ do: "step_by", count: -9 }), { index: 0, playing: false });
  assert.deepEqual(after({ do: "seek", index: 99 }), { index: 9, playing: false });
  assert.deepEqual(after({ do: "go_to_end" }), { index: 9, playing: false });
});

test("the nearest keyframe, stereo frame or event", () => {
  assert.equal(after({ do: "step_to", kind: "key_frame" }).index, 4);
  assert.equal(after({ do: "step_to", kind: "key_frame", forwards: false }).index, 0);
  assert.equal(after({ do: "step_to", kind: "stereo" }).index, 4);
  assert.equal(after({ do: "step_to_event" }).index, 5);
  assert.equal(after({ do: "step_to_event" }, { ...state, index: 5 }).index, 6);
  assert.equal(after({ do: "step_to_event", alarming: true }, { ...state, index: 5 }).index, 8);
  assert.equal(after({ do: "step_to_event", forwards: false }).index, 2);
  assert.match(after({ do: "step_to_event" }, { ...state, index: 8 }), /No event after frame 8/);
  assert.match(after({ do: "step_to", kind: "key_frame" }, { ...state, index: 7 }), /no keyframe after frame 7/);
});

test("playing begins again at the end, or at the start of the loop", () => {
  assert.deepEqual(after({ do: "play" }), { playing: true, index: 3 });
  assert.deepEqual(after({ do: "play" }, { ...state, index: 9 }), { playing: true, index: 0 });
  assert.deepEqual(after({ do: "play" }, { ...state, index: 5, loop: [2, 5] }), { playing: true, index: 2 });
  assert.deepEqual(after({ do: "play", on: false }, { ...state, playing: true }), { playing: false, index: 3 });
});

test("a loop has a start before its end", () => {
  assert.deepEqual(after({ do: "loop_edge", edge: "start" }), { loop: [3, null] });
  assert.deepEqual(after({ do: "loop_edge", edge: "end" }), { loop: [0, 3] });
  assert.deepEqual(after({ do: "loop_edge", edge: "end" }, { ...state, index: 1, loop: [2, null] }), { loop: [0, 1] });
  assert.deepEqual(after({ do: "loop_edge", edge: "start" }, { ...state, index: 6, loop: [2, 5] }), { loop: [6, null] });
  assert.deepEqual(after({ do: "set_loop", start: 2, end: 5 }), { loop: [2, 5] });
  assert.match(after({ do: "set_loop", start: 5, end: 5 }), /two frames/);
  assert.match(after({ do: "loop_edge", edge: "end" }, { ...state, index: 0 }), /two frames/);
  assert.match(after({ do: "loop_edge", edge: "start" }, { ...state, index: 9 }), /two frames/);
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
