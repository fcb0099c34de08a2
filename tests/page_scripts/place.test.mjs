// A page's own place in a run: moves, playback and loops.
import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { makePlace, moves } from "../../app/views/web/static/place.js";

const facts = {
  times: Array.from({ length: 12 }, (_, index) => 100 * index),
  kinds: "svsvsvsvsvsv",
  keyFrames: [0, 4, 7, 11],
  events: [
    { at: 2, severity: "ok" },
    { at: 5, severity: "lost" },
    { at: 8, severity: "warning" },
    { at: 6, severity: "" },
  ],
  computed: 10,
  goesOn: false,
};
const state = { index: 3, playing: false, loop: null, speed: 1 };
const after = (message, before = state) => moves[message.do](message, before, facts);

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
  assert.match(after({ do: "step_to", kind: "key_frame" }, { ...state, index: 7 }), /no keyframe after frame 7/, "11 is not computed");
  assert.equal(typeof after({ do: "step_to", kind: "key_frame", forwards: false }, { ...state, index: 0 }), "string");
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

// A page of a session at its newest frame, with a clock of its own.
function page({ goesOn = false, session = { index: 9, playing: false, loop: null, speed: 1 }, computed = 10 } = {}) {
  const said = [];
  const clock = { now: 0 };
  mock.timers.reset();
  mock.timers.enable({ apis: ["setTimeout"] });
  const place = makePlace({
    facts: () => ({ ...facts, computed, goesOn }),
    shared: () => session,
    changed: (own) => said.push({ ...own }),
    now: () => clock.now,
  });
  const pass = (ms) => {
    for (let left = ms; left > 0; left -= 20) {
      clock.now += 20;
      mock.timers.tick(20);
    }
  };
  return { place, said, pass, do: (message) => place.obey(message) };
}

test("the page's own place is told, and the session's is not changed", () => {
  const { place, said } = page();
  assert.equal(place.obey({ do: "step_by", count: -1 }), "");
  assert.deepEqual(said, [{ index: 8, playing: false }]);
  place.obey({ do: "speed", factor: 2 });
  assert.deepEqual(said.at(-1), { index: 8, playing: false, speed: 2 });
});

test("before the first frame there is nothing to look at", () => {
  const { place, said } = page({ computed: 0 });
  assert.notEqual(place.obey({ do: "seek", index: 3 }), "");
  assert.deepEqual(said, []);
});

test("it plays at the recorded speed up to the last computed frame", () => {
  const { place, said, pass } = page();
  place.obey({ do: "seek", index: 0 });
  place.obey({ do: "play" });
  pass(320);
  assert.equal(said.at(-1).index, 3);
  pass(2000);
  assert.deepEqual(said.at(-1), { index: 9, playing: false });
  assert.deepEqual(
    said.map(({ index }) => index),
    said.map(({ index }) => index).sort((a, b) => a - b),
  );
  place.obey({ do: "play" });
  assert.deepEqual(said.at(-1), { index: 0, playing: true }, "at the end, playing starts over");
});

test("it waits at the newest frame of a run that goes on", () => {
  const { place, said, pass } = page({ goesOn: true, session: { index: 9, playing: true, loop: null, speed: 1 } });
  place.obey({ do: "step_by", count: -2 });
  assert.deepEqual(said.at(-1), { index: 7, playing: false });
  place.obey({ do: "play" });
  pass(3000);
  assert.deepEqual(said.at(-1), { index: 9, playing: true });
});

test("it goes round in a loop of its own", () => {
  const { place, said, pass } = page();
  for (const message of [
    { do: "seek", index: 5 },
    { do: "loop_edge", edge: "start" },
  ])
    place.obey(message);
  for (const message of [{ do: "seek", index: 8 }, { do: "loop_edge", edge: "end" }, { do: "play" }]) place.obey(message);
  said.length = 0;
  pass(1500);
  assert.deepEqual([...new Set(said.map(({ index }) => index))].sort(), [5, 6, 7, 8]);
  assert.ok(said.every(({ playing }) => playing));
  place.obey({ do: "no_loop" });
  assert.equal(said.at(-1).loop, null);
});

test("as fast as possible is as fast as eyes follow", () => {
  const { place, said, pass } = page();
  for (const message of [{ do: "seek", index: 0 }, { do: "speed", factor: null }, { do: "play" }]) place.obey(message);
  pass(100);
  assert.equal(said.at(-1).index, 6);
});

test("one who follows again has no place", () => {
  const { place, said, pass } = page();
  for (const message of [{ do: "seek", index: 0 }, { do: "play" }]) place.obey(message);
  place.leave();
  said.length = 0;
  pass(1000);
  assert.deepEqual(said, []);
  place.obey({ do: "step_by", count: -1 });
  assert.deepEqual(said, [{ index: 8, playing: false }]);
});
