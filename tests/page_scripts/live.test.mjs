import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { advance, settle } from "./clock.mjs";

globalThis.document = { baseURI: "http://localhost/", visibilityState: "visible" };
const { feedLive } = await import("../../app/views/web/static/live.js");

let sockets = [];
globalThis.WebSocket = class {
  static OPEN = 1;
  readyState = 1;
  sent = [];
  constructor(url) {
    this.url = new URL(url);
    sockets.push(this);
  }
  send(message) {
    this.sent.push(message);
  }
};

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
  sockets = [];
  const calls = [];
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
    () => {},
    async () => calls.push("parting"),
  );
  const [socket] = sockets;
  const give = async (data) => {
    socket.onmessage({ data });
    await settle();
  };
  socket.onopen();
  fed = { stage, socket, calls, give, heard: (serial, of = "Recording:ispom:r1") => stage.heard((id) => (id === of ? serial : null)) };
  await give(JSON.stringify({ run: "run1", recording: "r1" }));
});

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

test("another frame is asked for only after the one before was taken in, and only the newest", async () => {
  const { stage, socket, give, heard } = fed;
  stage.want(30, true);
  await give(message(5, 30));
  stage.want(31, true);
  stage.want(32, true);
  assert.deepEqual(socket.sent, ["show 30 0"]);
  heard(5);
  assert.deepEqual(socket.sent.slice(1), ["show 32 5"]);
});

test("while a run plays, a slow viewer gets the next frame after a pause as long as it took for the last one", async () => {
  const { stage, socket, give, heard } = fed;
  stage.want(30, false);
  await give(message(5, 30));
  stage.want(31, false);
  await advance(200);
  heard(5);
  await advance(199);
  assert.deepEqual(socket.sent, ["show 30 0"]);
  stage.want(32, false);
  await advance(1);
  assert.deepEqual(socket.sent, ["show 30 0", "show 32 5"]);
});

test("somebody who waits for a frame ends that pause", async () => {
  const { stage, socket, give, heard } = fed;
  stage.want(30, false);
  await give(message(5, 30));
  await advance(200);
  heard(5);
  stage.want(31, false);
  assert.deepEqual(socket.sent, ["show 30 0"]);
  stage.want(31, true);
  assert.deepEqual(socket.sent, ["show 30 0", "show 31 5"]);
});

test("another run closes the channel of the one before, after the page took leave of it", async () => {
  const { stage, give, calls, heard } = fed;
  await give(message(5, 30));
  await give(JSON.stringify({ run: "run2", recording: "r2" }));
  assert.deepEqual(calls.slice(2), ["parting", "close run1", "open run2"]);
  await give(message(6, 0));
  stage.heard(() => null); // the viewer holds neither: the old one is gone, the new one has not begun
  assert.equal(stage.shown.recording, "Recording:ispom:r1");
  heard(6, "Recording:ispom:r2");
  assert.equal(stage.shown.recording, "Recording:ispom:r2");
});

test("a connection that ends is made again, from where it was", async () => {
  const { socket, give } = fed;
  await give(message(5, 30));
  socket.onclose();
  await advance(1000);
  const [, again] = sockets;
  assert.deepEqual(Object.fromEntries(again.url.searchParams), { run: "run1", serial: "5" });
});
