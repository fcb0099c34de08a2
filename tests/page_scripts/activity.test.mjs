import assert from "node:assert/strict";
import { test } from "node:test";
import { following, wordsOf } from "../../app/views/web/static/activity.js";

const COMPILING = (share) => `Compiling the estimators: ${share} %, about 20 s …`;

test("an activity whose words change stays in sight", () => {
  let activity = following(null, COMPILING(0), 7.5, 0);
  assert.equal(wordsOf(activity, 600), "", "what is quick is not shown");
  for (let now = 700, share = 1; now < 5000; now += 300, share += 1) {
    activity = following(activity, COMPILING(share), 7.5, now);
    assert.equal(wordsOf(activity, now), COMPILING(share), "it says itself for how long");
  }
});

test("one that begins anew waits again, and counts from there", () => {
  const activity = following(following(null, "rendering frame 1 …", 7.5, 0), "rendering frame 2 …", 8.5, 3000);
  assert.equal(wordsOf(activity, 3500), "");
  assert.equal(wordsOf(activity, 4000), "rendering frame 2 …");
  assert.equal(wordsOf(activity, 6000), "rendering frame 2 … 3 s");
});

test("nothing under way says nothing, and a frame that is asked for is shown at once", () => {
  assert.equal(wordsOf(following(null, null, null, 0), 9000), "");
  assert.equal(wordsOf(following(null, "computing up to frame 9: 3 done", null, 0), 0), "computing up to frame 9: 3 done");
});
