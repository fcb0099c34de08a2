import assert from "node:assert/strict";
import { test } from "node:test";
import { answer } from "../../app/features/answer/panel.js";
import { events, explain } from "../../app/features/explain/panel.js";
import { doctor } from "../../app/features/doctor/panel.js";
import { html } from "../../app/views/web/static/preact.js";

// Elements of a tree that have an attribute, and all its words.
function found(node, name) {
  if (Array.isArray(node)) return node.flatMap((each) => found(each, name));
  if (!node?.props) return [];
  return [...(node.props[name] === undefined ? [] : [node.props]), ...found(node.props.children, name)];
}

function words(node) {
  if (Array.isArray(node)) return node.map(words).join("");
  return typeof node === "object" ? words(node?.props?.children ?? "") : typeof node === "boolean" ? "" : String(node ?? "");
}

const check = { quantity: "stereo.parallax", mark: "✕", tint: "lost", hint: "", sentence: "Parallax too low.", numbers: "", name: "" };
const card = {
  ...{ method: "stereo", label: "Stereo", colour: "blue", severity: "warning", headline: "Warning", detail: "parallax: 1 px", tag: "" },
  ...{ when: "", decisive: null, failed: [check], ongoing: [{ frame: 3, headline: "Drift", sentence: "Drift: 5 %" }], details: null },
};
const view = {
  ...{ frame: 7, kind: "video", time_s: 0.5, waiting: "", skipped: "", thinned: false, cards: [card], settings: [] },
  ...{ plotted: ["stereo.parallax"], notes: ["<b>a note</b>"] },
};

test("a card has its verdict, its failed checks, and what still holds", () => {
  const drawn = explain(view, html);
  assert.match(words(drawn), /Frame 7.*Stereo.*Warning.*Parallax: 1 px\..*Drift since frame 3/s);
  assert.deepEqual(
    found(drawn, "data-plot").map((each) => [each["data-plot"], each["aria-pressed"]]),
    [["stereo.parallax", "true"]],
  );
  assert.deepEqual(
    found(drawn, "data-seek").map((each) => each["data-seek"]),
    [3],
  );
  assert.match(words(drawn), /<b>a note<\/b>/, "a note is a text, never markup");
});

test("before the first frame it says what to do", () => {
  assert.match(words(explain({ ...view, frame: -1, cards: [] }, html)), /Press Play/);
  assert.match(words(explain({ ...view, frame: -1, waiting: "Waiting for the first frame." }, html)), /Waiting/);
});

test("the event of the frame is marked, and only an alarming one can be examined", () => {
  const row = (frame, alarming) => ({ frame, frames: String(frame), label: "", sentence: "x", severity: "lost", alarming, help: "" });
  const drawn = events({ frame: 5, rows: [row(3, true), row(5, false)], earlier: 0, later: 2, omitted: 0, computed: 9 }, html);
  assert.deepEqual(
    found(drawn, "data-seek").map((each) => [each["data-seek"], each["aria-current"]]),
    [
      [3, undefined],
      [5, "true"],
    ],
  );
  assert.deepEqual(
    found(drawn, "data-doctor").map((each) => each["data-doctor"]),
    [3],
  );
  assert.match(words(drawn), /2 later/);
});

test("an examination shows its progress and can be cancelled, and then its cause", () => {
  const nothing = { stretch: [1, 9], progress: "", problem: "", answer: "", causes: [], others: [], reruns: [], silent: [], left: [] };
  const asks = (drawn) => found(drawn, "data-do").map((each) => JSON.parse(each["data-do"]).do);
  assert.deepEqual(asks(doctor({ ...nothing, progress: "1 of 5: blur" }, html)), ["cancel_examination"]);
  const cause = { name: "blur", state: "found", strength: 0.9, evidence: "", undecided: "", remedy: "use `--fast`", frames: [4] };
  const drawn = doctor({ ...nothing, causes: [cause], helped: true }, html);
  assert.deepEqual(asks(drawn), ["examine", "fork_with_remedy"]);
  assert.match(words(drawn), /The likely cause: blur.*use --fast/s);
});

test("the answer line has what can be done at the frame, and nothing else", () => {
  const calm = { tone: "ok", text: "x", working: false, diagnose: null, thorough: false, applies: false, show: null };
  const asks = (change) => found(answer({ ...calm, ...change }, html), "data-do").map((each) => JSON.parse(each["data-do"]));
  assert.deepEqual(asks({}), []);
  assert.deepEqual(asks({ working: true }), [{ do: "cancel_examination" }]);
  assert.deepEqual(asks({ diagnose: 21, show: 21 }), [
    { do: "examine", at: 21 },
    { do: "seek", index: 21 },
  ]);
  assert.deepEqual(asks({ diagnose: 21, thorough: true }), [{ do: "examine", at: 21, thorough: true }]);
  assert.deepEqual(asks({ applies: true }), [{ do: "fork_with_remedy" }]);
  assert.equal(found(answer({ ...calm, text: "long" }, html), "title")[0].title, "long");
});
