import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { advance, settle } from "./clock.mjs";

const { feedLive } = await import("../../app/views/web/static/live.js");

// As the server heads its messages: serial number, frame, whether it is whole.
function message(serial, index, complete = true) {
  const head = new DataView(new ArrayBuffer(14));
  head.setUint32(0, serial);
  head.setUint32(4, index);
  head.setUint8(8, Number(complete));
  return head.buffer;
}

let fed;
beforeEach(async () => {
  const calls = [];
  const sent = [];
  let opened = 0;
  const handle = {
    open_channel: () => {
      const name = `run${++opened}`;
      calls.push(`open ${name}`);
      return { send_rrd: (bytes) => calls.push(`${bytes.length} bytes to ${name}`), close: () => calls.push(`close ${name}`) };
    },
  };
  const stage = feedLive(
    handle,
    (message) => sent.push(message) > 0,
    () => {},
    async () => calls.push("parting"),
  );
  const give = async (data) => {
    stage.streamed(data);
    await settle();
  };
  fed = { stage, sent, calls, give, heard: (serial, of = "Recording:ispom:r1") => stage.heard((id) => (id === of ? serial : null)) };
  await give({ run: "run1", recording: "r1" });
});

// What the page has said since, as serial numbers.
const serials = (sent) => sent.map(({ serial }) => serial);

test("a frame is shown when the viewer has taken its message in, and not before", async () => {
  const { stage, give, heard, calls } = fed;
  await give(message(5, 30));
  assert.deepEqual(calls, ["open run1", "2 bytes to run1"]);
  assert.equal(stage.shown, null);
  heard(4);
  assert.equal(stage.shown, null);
  heard(5);
  assert.deepEqual(stage.shown, { recording: "Recording:ispom:r1", index: 30, complete: true });
});

test("the viewer takes another frame only after it has taken in the one before", async () => {
  const { sent, give, heard } = fed;
  assert.deepEqual(sent, [{ do: "ready", run: "", serial: 0 }]);
  await give(message(5, 30));
  heard(4);
  assert.deepEqual(serials(sent), [0]);
  heard(5);
  assert.deepEqual(sent[1], { do: "ready", run: "run1", serial: 5 });
  heard(5);
  assert.deepEqual(serials(sent), [0, 5]);
});

test("while a run plays, a slow viewer gets the next frame after a pause as long as it took for the last one", async () => {
  const { stage, sent, give, heard } = fed;
  stage.want(30, false);
  await give(message(5, 30));
  await advance(200);
  heard(5);
  await advance(199);
  assert.deepEqual(serials(sent), [0]);
  stage.want(32, false);
  await advance(1);
  assert.deepEqual(serials(sent), [0, 5]);
});

test("somebody who waits for a frame ends that pause", async () => {
  const { stage, sent, give, heard } = fed;
  stage.want(30, false);
  await give(message(5, 30));
  await advance(200);
  heard(5);
  stage.want(31, false);
  assert.deepEqual(serials(sent), [0]);
  stage.want(31, true);
  assert.deepEqual(serials(sent), [0, 5]);
});

test("another run closes the channel of the one before, after the page took leave of it", async () => {
  const { stage, give, calls, heard } = fed;
  await give(message(5, 30));
  await give({ run: "run2", recording: "r2" });
  assert.deepEqual(calls.slice(2), ["parting", "close run1", "open run2"]);
  await give(message(6, 0));
  stage.heard(() => null); // the viewer holds neither: the old one is gone, the new one has not begun
  assert.equal(stage.shown.recording, "Recording:ispom:r1");
  heard(6, "Recording:ispom:r2");
  assert.equal(stage.shown.recording, "Recording:ispom:r2");
});

test("on a new line to the server the page says what its viewer has", async () => {
  const { stage, sent, give, heard } = fed;
  await give(message(5, 30));
  heard(5);
  stage.connected();
  assert.deepEqual(sent.slice(1), Array(2).fill({ do: "ready", run: "run1", serial: 5 }));
});
