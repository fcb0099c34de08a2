// Counts of images are counts of images, and of a frame that is on its way nothing is claimed.
import assert from "node:assert/strict";
import { test } from "node:test";
import { imagesUpTo, lateness } from "../../app/views/web/static/frame_words.js";

test("frames of several clocks are counted each by itself", () => {
  const kinds = "svvvvvsv";
  assert.equal(imagesUpTo(kinds, 6), "video 5 of 6, stereo 2 of 2");
  assert.equal(imagesUpTo(kinds, -1), "video 0 of 6, stereo 0 of 2");
  assert.equal(imagesUpTo("iiviiv", 2), "video 1 of 2");
  assert.equal(imagesUpTo("vvv", 1), "", "the number of the frame says it");
});

test("the views are said to show an earlier frame only where nothing of another was given to them", () => {
  const shown = { index: 46, complete: true };
  assert.match(lateness({ shown, wanted: 68, coming: 46, other: null }), /the views show 46$/);
  assert.match(lateness({ shown, wanted: 68, coming: 68, other: null }), /46 or already 68$/);
  assert.match(lateness({ shown, wanted: 46, coming: 68, other: null }), /^loading frame 68: .*46 or already 68$/);
  assert.equal(lateness({ shown, wanted: 46, coming: 46, other: null }), "");
  assert.match(lateness({ shown: { index: 46, complete: false }, wanted: 46, coming: 46, other: null }), /images of frame 46/);
});
