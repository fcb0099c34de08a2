import assert from "node:assert/strict";
import { test } from "node:test";
import { whenText } from "../../app/views/web/static/when.js";

const at = (...parts) => new Date(...parts).getTime() / 1000;
const NOW = at(2026, 10, 27, 15, 0); // a Friday

test("the last days are named, and older ones have their date", () => {
  assert.equal(whenText(at(2026, 10, 27, 0, 0), NOW), "today 00:00");
  assert.equal(whenText(at(2026, 10, 26, 23, 59), NOW), "yesterday 23:59");
  assert.equal(whenText(at(2026, 10, 24, 12, 0), NOW), "Tuesday");
  assert.equal(whenText(at(2026, 10, 20, 12, 0), NOW), "20 Nov 2026");
});

test("a file of the future, from a wrong clock, has its date", () => {
  assert.equal(whenText(at(2027, 0, 2, 12, 0), NOW), "2 Jan 2027");
});
