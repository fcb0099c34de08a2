import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { advance } from "./clock.mjs";

let painted = 0; // frames that the browser was asked for
globalThis.window = {
  requestAnimationFrame: (callback) => {
    painted++;
    setTimeout(() => callback(performance.now()), 16);
  },
};
const { afterData, afterFrames, expectData, wake } = await import("../../app/views/web/static/render_throttle.js");
const draw = () => window.requestAnimationFrame(draw); // as the viewer does, without end
draw();

async function framesIn(ms) {
  const before = painted;
  await advance(ms);
  return painted - before;
}

beforeEach(async () => {
  expectData(0);
  await advance(200_000); // asleep
});

test("while nothing happens, frames become rare", async () => {
  assert.ok((await framesIn(60_000)) <= 3);
});

test("after something happened frames are free for a moment, then rare again", async () => {
  wake();
  assert.ok((await framesIn(600)) > 20);
  await advance(10_000);
  assert.ok((await framesIn(10_000)) <= 2);
});

test("while messages are unread it goes on drawing, and says after each frame that it may have read some", async () => {
  let looked = 0;
  afterData(() => looked++);
  expectData(3);
  assert.ok((await framesIn(5_000)) > 200);
  assert.ok(looked > 200);
  expectData(0);
  await advance(20_000);
  assert.ok((await framesIn(10_000)) <= 2);
});

test("whoever wants to see a frame is called after each until it has seen enough", async () => {
  let left = 3;
  afterFrames(() => --left === 0);
  await advance(1000);
  assert.equal(left, 0);
});
