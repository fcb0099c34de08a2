import assert from "node:assert/strict";
import { test } from "node:test";
import { drawAxis, heightOf, laneAt, outagesOf } from "../../app/views/web/static/axis_picture.js";

globalThis.devicePixelRatio = 1;
globalThis.document = { documentElement: null };
globalThis.getComputedStyle = () => ({ getPropertyValue: (name) => name });

const method = (label, more = {}) => ({ label, colour: label, keyFrames: [], lost: [], ...more });
const rowOf = (label, indices) => ({
  matches: { sign: "row", label, help: `Frames at which ${label} is true`, marks: indices.map((at) => ({ at })) },
});
const SENSORS = { i: "IMU", g: "GNSS", w: "Wheels", l: "Laser", b: "Barometer", o: "Others" };
const axisOf = (more) => ({ times: [0, 33], kinds: "vs", sensors: SENSORS, methods: [method("Stereo")], computed: 2, marks: {}, ...more });

// What is drawn: rectangles [x, y, width, height, fill].
function drawn(axis, width, place) {
  const found = [];
  const ink = { scale() {}, fillText() {}, fillRect: (...box) => found.push([...box, ink.fillStyle]) };
  drawAxis({ getContext: () => ink }, width, axis, place);
  return found;
}

test("of 5,000 frames no pixel is drawn twice in a row", () => {
  const indices = [...Array(5000).keys()];
  const methods = [0, 1, 2].map((i) =>
    method(`own${i}`, {
      keyFrames: indices,
      lost: [
        [10, 19],
        [4000, 4009],
      ],
    }),
  );
  const axis = axisOf({
    times: indices,
    kinds: "vvvs".repeat(1250),
    methods,
    computed: 5000,
    marks: rowOf("stereo.key_frame", indices),
  });
  const count = drawn(axis, 1016, (index) => (index * 1000) / 5000).length;
  assert.ok(5000 < count && count < 6060, `${count}: six rows of 1,000 pixels, bars, ticks of the ruler`);
});

test("losses span their frames", () => {
  const boxes = drawn(
    axisOf({ times: [...Array(100).keys()], kinds: "v".repeat(100), methods: [method("own", { lost: [[10, 19]] })] }),
    1016,
    (i) => 10 * i,
  );
  assert.deepEqual(
    boxes.filter(([, , , , fill]) => fill === "--alarm").map(([x, , width]) => [x, width]),
    [[100, 100]],
  );
});

test("a run without frames is an empty picture", () => {
  assert.deepEqual(
    drawn(axisOf({ times: [], kinds: "" }), 1016, () => 0),
    [],
  );
});

test("each height has the row that is drawn there", () => {
  const axis = axisOf({ methods: [method("Monocular"), method("Stereo")], marks: rowOf("exposure > 3", []), events: [{ at: 1 }] });
  const rows = [...Array(heightOf(axis)).keys()].map((y) => laneAt(axis, y)).filter((text, y, all) => text !== all[y - 1]);
  const found = rows.map((text) => text.split(/[ :]/)[0]);
  assert.deepEqual(found, ["Frame", "Video", "Stereo", "Monocular", "Stereo", "Events", "Frames", ""]);
  assert.ok(heightOf({ ...axis, events: [], marks: rowOf("", []) }) < heightOf(axis));
});

test("each sensor has a row, and a stretch without its measurements is an outage", () => {
  const kinds = "vgvgvgvvvvvvgvgvvvvvvv";
  const axis = axisOf({ times: [...kinds].map((_, i) => 100 * i), kinds });
  assert.deepEqual(outagesOf(axis, "g"), [
    [5, 12],
    [14, 21],
  ]);
  assert.deepEqual(outagesOf(axis, "i"), []);
  const rows = [...Array(heightOf(axis)).keys()].map((y) => laneAt(axis, y));
  assert.ok(rows.some((text) => text.startsWith("GNSS")) && !rows.some((text) => text.startsWith("IMU")));
  const red = drawn(axis, 1016, (i) => 10 * i).filter(([, , , , fill]) => fill === "--alarm");
  assert.deepEqual(
    red.map(([x, , width]) => [x, width]),
    [
      [50, 70],
      [140, 70],
    ],
  );
});

test("whatever kinds of marks come are drawn by their signs", () => {
  const marks = {
    mine: { sign: "diamond", marks: [{ at: 1, colour: "red" }] },
    yours: { sign: "flag", marks: [{ at: 1, colour: "" }] },
  };
  const place = (i) => 10 * i;
  const fills = drawn(axisOf({ marks }), 1016, place)
    .slice(drawn(axisOf({}), 1016, place).length)
    .map(([, , , , fill]) => fill);
  assert.equal(fills.filter((fill) => fill === "red").length, 6);
  assert.equal(fills.filter((fill) => fill === "--accent").length, 2);
});

test("a sensor of any registered kind has a row by its label", () => {
  const axis = axisOf({ times: [0, 33, 66], kinds: "vbv" });
  const rows = [...Array(heightOf(axis)).keys()].map((y) => laneAt(axis, y));
  assert.ok(rows.some((text) => text.startsWith("Barometer: ")));
});
