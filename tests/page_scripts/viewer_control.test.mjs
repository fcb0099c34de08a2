// Messages are read back here by the general rules of protobuf, independently of the script.
import assert from "node:assert/strict";
import { test } from "node:test";
import { closeRecordings, redraw, stateOf, updateBlueprint } from "../../app/views/web/static/viewer_control.js";

const varint = (value) => (value < 128 ? [value] : [(value % 128) | 128, ...varint(Math.floor(value / 128))]);
const number = (tag, value) => [...varint(tag * 8), ...varint(value)];
const nested = (tag, ...parts) => [...varint(tag * 8 + 2), ...varint(parts.flat().length), ...parts.flat()];
const text = (tag, value) => nested(tag, [...new TextEncoder().encode(value)]);

test("requests are as viewer_control.proto has them", () => {
  const cursor = nested(6, text(1, "Recording:ispom:é"), nested(2, text(1, "stage")), nested(3, number(1, 0)), number(5, 1));
  assert.deepEqual([...redraw("Recording:ispom:é")], cursor);
  assert.deepEqual([...closeRecordings(["a", "b"])], nested(1, nested(3, text(1, "a"), text(1, "b"))));
  const layout = { "/viewport": { x: 1 } };
  assert.deepEqual([...updateBlueprint("a", layout)], nested(14, text(2, JSON.stringify(layout)), nested(3, text(1, "a")), number(5, 2)));
});

test("the viewer's state names what is on the screen, and the newest message", () => {
  const range = (timeline, newest) => nested(2, nested(1, text(1, timeline)), nested(3, number(1, 0), number(2, newest)));
  const shown = nested(3, text(1, "one"), range("exposure", 5000), range("stage", 70_000), number(5, 1));
  const state = stateOf(Uint8Array.from([...text(2, "one"), ...shown, ...nested(3, text(1, "two")), ...number(99, 2 ** 40)]));
  assert.deepEqual(state, {
    active: "one",
    recordings: [
      { id: "one", serial: 70_000 },
      { id: "two", serial: 0 },
    ],
  });
});

test("an empty state has no recordings", () => {
  assert.deepEqual(stateOf(new Uint8Array()), { active: null, recordings: [] });
});
