import assert from "node:assert/strict";
import { test } from "node:test";
import { advance } from "./clock.mjs";

let pictures = 0;
const ink = { scale() {}, fillRect() {}, fillText() {} };
const element = () => ({
  hidden: false,
  style: { setProperty() {} },
  clientWidth: 1016,
  dataset: {},
  addEventListener() {},
  appendChild: (part) => part,
  replaceChildren() {},
  querySelector: () => ({ getContext: () => pictures++ < Infinity && ink }),
});
globalThis.devicePixelRatio = 1;
globalThis.document = { getElementById: element, createElement: element, documentElement: null };
globalThis.getComputedStyle = () => ({ getPropertyValue: () => "" });
globalThis.ResizeObserver = class {
  observe() {}
};
const { makeAxis } = await import("../../app/views/web/static/time_axis.js");

const times = [...Array(500).keys()];
const begun = { methods: [{ label: "Stereo", colour: "" }], times_ms: times, kinds: "v".repeat(500), computed: 0, results: [] };
const grown = (index, more) => ({ index, loop: null, axis: { computed: index + 1, results: [{ key_frames: [], lost: [], ...more }] } });

test("a run that goes on is drawn once for many frames, and all of them are in the picture", async () => {
  const axis = makeAxis(() => {});
  pictures = 0;
  axis.show({ index: 0, loop: null, axis: begun });
  assert.equal(pictures, 1);
  for (const index of times) axis.show(grown(index));
  assert.equal(pictures, 1);
  await advance(1000);
  assert.equal(pictures, 2);
  assert.equal(axis.data.computed, 500);
});

test("what only moves the cursor draws no picture", async () => {
  const axis = makeAxis(() => {});
  axis.show({ index: 0, loop: null, axis: begun });
  pictures = 0;
  axis.show({ index: 7, loop: null });
  await advance(5000);
  assert.equal(pictures, 0);
});

test("keyframes are gathered, and losses that follow each other are one", () => {
  const axis = makeAxis(() => {});
  axis.show({ index: 0, loop: null, axis: begun });
  axis.show(grown(3, { key_frames: [0, 3], lost: [[1, 2]] }));
  axis.show(grown(5, { key_frames: [5], lost: [[3, 4]] }));
  axis.show(grown(9, { lost: [[8, 9]] }));
  const [method] = axis.data.methods;
  assert.deepEqual(method.keyFrames, [0, 3, 5]);
  assert.deepEqual(method.lost, [
    [1, 4],
    [8, 9],
  ]);
  axis.show({ index: 0, loop: null, axis: begun });
  assert.deepEqual(axis.data.methods[0].keyFrames, []);
});

test("marks of a kind are replaced, or come to those before, and go with the run", () => {
  const axis = makeAxis(() => {});
  const show = (marks, more = {}) => axis.show({ index: 0, loop: null, axis: { marks, ...more } });
  show({ a: { sign: "row", label: "x", marks: [{ at: 1 }] } }, begun);
  show({ a: { more: true, marks: [{ at: 2 }] }, b: { sign: "flag", marks: [{ at: 3 }] } });
  assert.deepEqual(
    axis.data.marks.a.marks.map(({ at }) => at),
    [1, 2],
  );
  assert.equal(axis.data.marks.a.label, "x");
  show({ b: { sign: "flag", marks: [] } });
  assert.deepEqual(axis.data.marks.b.marks, []);
  show({}, begun);
  assert.deepEqual(axis.data.marks, {});
});
