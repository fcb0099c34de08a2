import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { advance } from "./clock.mjs";

let listeners = {};
let kept = {};
globalThis.addEventListener = (kind, listener) => (listeners[kind] = listener);
globalThis.sessionStorage = {
  getItem: (key) => kept[key] ?? null,
  setItem: (key, value) => (kept[key] = String(value)),
  removeItem: (key) => delete kept[key],
};
globalThis.history = { replaceState: (_data, _title, hash) => (location.hash = hash) };
globalThis.location = { hash: "" };
const { makeAddress } = await import("../../app/views/web/static/address.js");

const stateOf = ({ run = "sim:city", branch = 0, hidden = [], layers = [], plots = "", lesson = "", ...more }) => ({
  phase: "ready",
  index: 5,
  selected: "",
  playing: false,
  notices: [],
  target: null,
  activity: null,
  question: null,
  address: { run, branch, hidden, layers, plots, lesson },
  ...more,
});

// A page that is opened with this address; it changes the session, unless it follows another page.
function opened(hash, drives = true) {
  location.hash = hash;
  const sent = [];
  const modes = { mode: "debug", set: (mode) => (modes.mode = mode) };
  const address = makeAddress(
    (command) => sent.push(command),
    () => drives,
    modes,
  );
  return { sent, modes, ...address };
}

beforeEach(() => ([listeners, kept] = [{}, {}]));

test("the address names what is shown, and nothing that is as usual", async () => {
  const { follow } = opened("");
  follow(stateOf({}));
  await advance(1000);
  assert.equal(location.hash, "#run=sim:city&at=5");
  follow(stateOf({ branch: 2, hidden: ["clouds", "truth"], layers: ["depth"], selected: "track:stereo:181", plots: "stereo.inliers" }));
  await advance(1000);
  assert.equal(location.hash, "#run=sim:city&branch=2&hidden=clouds,truth&layers=depth&select=track:stereo:181&plot=stereo.inliers&at=5");
});

test("of many changes in a moment one is written", async () => {
  const { follow } = opened("");
  let written = 0;
  const { replaceState } = history;
  history.replaceState = (...words) => replaceState(...words, written++);
  follow(stateOf({ index: 0 }));
  await advance(1);
  for (let index = 1; index < 100; index++) follow(stateOf({ index }));
  await advance(1000);
  history.replaceState = replaceState;
  assert.equal(written, 2);
  assert.equal(location.hash, "#run=sim:city&at=99");
});

test("an address that is opened is reached step by step, in its order", () => {
  const { follow, sent } = opened("#run=other&branch=1&at=7");
  follow(stateOf({}));
  assert.deepEqual(sent, [{ do: "open_named", name: "other" }]);
  follow(stateOf({ phase: "opening" }));
  assert.equal(sent.length, 1);
  follow(stateOf({ run: "other" }));
  follow(stateOf({ run: "other", branch: 1 }));
  assert.deepEqual(sent.slice(1), [
    { do: "show_branch", number: 1 },
    { do: "seek", index: 7 },
  ]);
});

test("optional layers of an address are chosen", () => {
  const { follow, sent } = opened("#run=sim:city&layers=depth&at=5");
  follow(stateOf({}));
  assert.deepEqual(sent, [{ do: "choose", names: ["depth"] }]);
});

test("while an address is to be reached, it is not written over", async () => {
  const { follow } = opened("#run=sim:city&at=700");
  follow(stateOf({}));
  await advance(1000);
  assert.equal(location.hash, "#run=sim:city&at=700");
});

test("a part that is refused is given up, and the address then says what is shown", async () => {
  const { follow } = opened("#run=nowhere&at=7");
  follow(stateOf({}));
  follow(stateOf({ notices: [{ kind: "error", number: 1 }] }));
  await advance(1000);
  assert.equal(location.hash, "#run=sim:city&at=5");
});

test("a part that does not come is given up after a while", async () => {
  const { follow } = opened("#run=sim:city&at=9999");
  follow(stateOf({}));
  await advance(10_000);
  assert.equal(location.hash, "#run=sim:city&at=5");
});

test("a page that follows another one goes to its frame only", () => {
  const { follow, sent } = opened("#run=other&at=7&hidden=clouds", false);
  follow(stateOf({}));
  assert.deepEqual(sent, [{ do: "seek", index: 7 }]);
});

test("an address that is typed is followed", () => {
  const { follow, sent } = opened("");
  follow(stateOf({}));
  location.hash = "#run=sim:city&at=8";
  listeners.hashchange();
  assert.deepEqual(sent, [{ do: "seek", index: 8 }]);
});

test("a reload before the address was written goes by what was shown", () => {
  const before = opened("#run=sim:city&at=4");
  for (const index of [4, 5]) before.follow(stateOf({ index }));
  const late = opened("#run=sim:city&at=4");
  late.follow(stateOf({ index: 0 }));
  assert.deepEqual(late.sent, [{ do: "seek", index: 5 }]);
});

test("the page's mode is taken from the address and named in it", async () => {
  const { follow, modes } = opened("#run=sim:city&at=5&mode=learn");
  assert.equal(modes.mode, "learn");
  modes.mode = "compare";
  follow(stateOf({}));
  await advance(1000);
  assert.equal(location.hash, "#run=sim:city&at=5&mode=compare");
});

test("a lesson is named alone", async () => {
  const { follow } = opened("");
  follow(stateOf({ lesson: "collapse:2" }));
  await advance(1000);
  assert.equal(location.hash, "#lesson=collapse:2");
});
