import assert from "node:assert/strict";
import { test } from "node:test";
import { advance, settle } from "./clock.mjs";

globalThis.window = { requestAnimationFrame: () => {} };
const { makeCursor } = await import("../../app/views/web/static/rerun_cursor.js");
const { setTimeCursor, TIMELINE } = await import("../../app/views/web/static/viewer_control.js");

// A cursor with a viewer that answers all requests: what it was asked for, and where hands moved ours.
function made() {
  const listeners = {};
  const canvas = { addEventListener: (kind, listener) => (listeners[kind] = listener) };
  const found = { seeks: [], requests: [], answers: true, touch: (type) => listeners[type]({ type, buttons: 1 }) };
  found.cursor = makeCursor(
    canvas,
    (index) => found.seeks.push(index),
    async (request) => {
      found.requests.push(String(request));
      return found.answers;
    },
  );
  return found;
}
const shown = (more) => ({ id: "run", timeline: TIMELINE, time: 7, paused: true, ...more });
const request = (index, store = "run") => String(setTimeCursor(store, TIMELINE, index));
const update = (time) => ({ type: "time_update", time });

test("a frame is asked for once", async () => {
  const { cursor, requests } = made();
  cursor.show(shown(), 7);
  cursor.show(shown(), 7);
  await settle();
  cursor.show(shown(), 7);
  await settle();
  assert.deepEqual(requests, [request(7)]);
});

test("of frames that come while one is asked for only the last is", async () => {
  const { cursor, requests } = made();
  for (const index of [7, 8, 9]) cursor.show(shown(), index);
  await settle();
  assert.deepEqual(requests, [request(7), request(9)]);
});

test("where the viewer shows another time than it was asked for, it is asked again", async () => {
  const { cursor, requests } = made();
  cursor.show(shown(), 7);
  await settle();
  cursor.show(shown({ time: 3 }), 7);
  await settle();
  assert.deepEqual(requests, [request(7), request(7)]);
});

test("a request that failed is made again with the next state", async () => {
  const found = made();
  found.answers = false;
  found.cursor.show(shown(), 7);
  await settle();
  found.answers = true;
  found.cursor.show(shown(), 7);
  await settle();
  assert.equal(found.requests.length, 2);
});

test("another recording is asked for the same frame", async () => {
  const { cursor, requests } = made();
  cursor.show(shown(), 7);
  await settle();
  cursor.show(shown({ id: "next" }), 7);
  await settle();
  assert.deepEqual(requests, [request(7), request(7, "next")]);
});

test("a change of time without a hand is no seek, nor are late answers", async () => {
  const found = made();
  found.cursor.show(shown(), 7);
  await settle();
  found.cursor.heard(update(3));
  found.cursor.show(shown(), 8);
  await settle();
  found.touch("pointerdown");
  for (const time of [7, 8]) found.cursor.heard(update(time));
  await advance(5000);
  assert.deepEqual(found.seeks, []);
});

test("a hand in the viewer seeks, and of a drag where it went", async () => {
  const found = made();
  found.cursor.show(shown(), 7);
  await settle();
  found.touch("pointerdown");
  for (const time of [10, 11, 12.2]) found.cursor.heard(update(time));
  await advance(100);
  assert.deepEqual(found.seeks, [12]);
  assert.deepEqual(found.requests, [request(7)]);
});

test("while a hand is pressed the viewer is left alone", async () => {
  const found = made();
  found.touch("pointerdown");
  found.cursor.show(shown(), 7);
  await advance(400);
  assert.deepEqual(found.requests, []);
  await advance(200);
  assert.deepEqual(found.requests, [request(7)]);
});

test("where the hand went is said before the page goes on elsewhere", async () => {
  const found = made();
  found.touch("pointerdown");
  found.cursor.heard(update(10));
  found.cursor.release();
  assert.deepEqual(found.seeks, [10]);
  await advance(5000);
  assert.deepEqual(found.seeks, [10]);
});
