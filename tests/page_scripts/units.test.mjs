import assert from "node:assert/strict";
import { test } from "node:test";
import { digits, shownUnit } from "../../app/views/web/static/units.js";

test("lengths and times have a unit that fits their size", () => {
  assert.deepEqual(shownUnit("m", 0.00028), { name: "mm", factor: 1e3 });
  assert.deepEqual(shownUnit("m", -1.5), { name: "m", factor: 1 });
  assert.deepEqual(shownUnit("m", 1200), { name: "km", factor: 1e-3 });
  assert.deepEqual(shownUnit("s", 0.014), { name: "ms", factor: 1e3 });
});

test("other units are left as they are", () => {
  assert.deepEqual(shownUnit("px", 0.001), { name: "px", factor: 1 });
});

test("numbers have three significant digits", () => {
  assert.deepEqual([0, 0.28, 19.66, 345, 12345.6, -0.1234].map(digits), ["0", "0.28", "19.7", "345", "12346", "-0.123"]);
  assert.equal(digits(0.00012345), "0.00012");
  assert.equal(digits(NaN), "–");
});
