// The share of frames located: of each method, never one for all.
import assert from "node:assert/strict";
import { test } from "node:test";
import { locatedTexts } from "../../app/views/web/static/located.js";

test("each method has its own share, and equal ones are said once", () => {
  const located = [
    ["Monocular", 0.9608],
    ["Stereo", 0.9355],
  ];
  assert.deepEqual(locatedTexts({ kind: "run", located }), ["Monocular 96 %", "Stereo 93.5 %"]);
  assert.deepEqual(
    locatedTexts({
      kind: "run",
      located: [
        ["Monocular", 1],
        ["Stereo", 1],
      ],
    }),
    ["100 %"],
  );
  assert.deepEqual(locatedTexts({ kind: "sweep", located: [["Stereo", 0.5]] }), ["from 50 %"]);
  assert.deepEqual(locatedTexts({ kind: "run", located: [] }), ["–"]);
});
