// What the page orders of the Rerun viewer.
import assert from "node:assert/strict";
import { test } from "node:test";
import {
  closeOthers,
  isActive,
  redraw,
  serialOf,
  showFrame,
  showsAnother,
  updateBlueprint,
} from "../../app/views/web/static/viewer_control.js";

const OWN = "Recording:ispom:own";

// A WebViewer that shows the recording `active`, of these that it holds.
function viewer({ active = "own", stores = [OWN] } = {}) {
  const asked = [];
  let layout = { "/viewport": { Viewport: { share: 1 } } };
  const web = {
    set_time: async (given) => asked.push(given),
    get_state: async () => ({ recordings: stores.map((store_id) => ({ store_id })) }),
    close: async (given) => asked.push(given),
    get_blueprint: async () => ({ blueprint: structuredClone(layout) }),
    set_blueprint: async (given) => {
      layout = given;
    },
    get_time_range: (recording) => (recording === "own" ? { min: 0, max: 70_000 } : null),
    get_active_recording_id: () => active,
  };
  return { web, asked, layout: () => layout };
}

test("time is set in a recording, and nothing plays", async () => {
  const { web, asked } = viewer();
  await redraw(OWN)(web);
  await showFrame(OWN, 12)(web);
  assert.deepEqual(
    asked.map(({ recording, sequence, play_state }) => [recording, sequence, play_state]),
    [
      [OWN, 0, "paused"],
      [OWN, 12, "paused"],
    ],
  );
  assert.notEqual(asked[0].timeline, asked[1].timeline);
});

test("all recordings but the run's are closed", async () => {
  const { web, asked } = viewer({ stores: [OWN, "Recording:ispom:old"] });
  await closeOthers(OWN)(web);
  assert.deepEqual(asked, [{ store_ids: ["Recording:ispom:old"] }]);
  const alone = viewer();
  await closeOthers(OWN)(alone.web);
  assert.deepEqual(alone.asked, []);
});

test("changes of the layout leave the rest, and none is lost where two come at once", async () => {
  const { web, layout } = viewer();
  const behaviour = (visible) => ({ EntityBehavior: { visible: [visible] } });
  await Promise.all([
    updateBlueprint(OWN, { "/a": behaviour(false) })(web),
    updateBlueprint(OWN, { "/b": behaviour(true), "/viewport": { Viewport: { name: "x" } } })(web),
  ]);
  assert.deepEqual(layout(), { "/viewport": { Viewport: { share: 1, name: "x" } }, "/a": behaviour(false), "/b": behaviour(true) });
});

test("the viewer says which recording it shows, and which message it took in last", () => {
  const { web } = viewer();
  assert.equal(serialOf(web, OWN), 70_000);
  assert.equal(serialOf(web, "Recording:ispom:other"), null);
  assert.deepEqual([isActive(web, OWN), showsAnother(web, OWN)], [true, false]);
  const other = viewer({ active: "strange" }).web;
  assert.deepEqual([isActive(other, OWN), showsAnother(other, OWN)], [false, true]);
  const none = viewer({ active: null }).web;
  assert.deepEqual([isActive(none, OWN), showsAnother(none, OWN)], [false, false]);
});
