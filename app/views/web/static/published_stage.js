// What Rerun draws on a published page: the whole recording, given to the viewer piece by piece. Then the viewer's time
// cursor follows the page. Of the form of the file see app/features/publish/stage.py.
import { afterFrames } from "./frames.js";
import { addressOf, unpacked } from "./published.js";
import { isActive, showFrame } from "./viewer_control.js";

const SETTLED_FRAMES = 3; // in which the viewer makes a layout that it was given its own

// As feedLive of live.js; `want` is told which recording the page shows: its id, its file, and the last frame of each piece.
// `control` sends a message to the viewer, and returns whether the viewer took it.
export function feedPublished(handle, news, control) {
  const stage = {
    file: "", // of the recording that the viewer is given
    recording: null, // its id
    frames: [],
    channel: null, // of the viewer, for it
    shown: null, // { recording, index, complete } that the views show
    wanted: null, // the frame that they are to show
    unread: [], // the frame that the viewer was asked to show, until it does
    given: -1, // pieces that the viewer was given after the first, which has the layout
    taken: 0, // pieces that it has taken in
  };
  // A frame is whole when the piece that has its end, and those before, were taken in.
  const isThere = (index) => stage.taken >= stage.frames.length || index <= (stage.frames[stage.taken - 1] ?? -1);
  stage.redraw = () => stage.shown && showFrame(stage.recording, stage.shown.index);
  stage.want = (index, _, recorded) => {
    if (recorded.file !== stage.file) turn(recorded);
    stage.wanted = index;
    ask();
  };
  stage.heard = (serialOf) => {
    stage.taken = serialOf(stage.recording) ?? 0;
    if (isActive(handle, stage.recording)) laidOut();
    ask();
  };
  let laidOut = () => {};
  async function ask() {
    const { wanted, shown, unread, recording } = stage;
    if (wanted === null || unread.length || !isThere(wanted)) return;
    if (shown?.index === wanted && shown.recording === recording) return;
    unread.push({ index: wanted });
    const done = await control(showFrame(recording, wanted));
    unread.pop();
    if (recording !== stage.recording) return ask(); // another one was chosen meanwhile
    if (done) stage.shown = { recording, index: wanted, complete: true };
    if (done) news();
  }
  // Another recording from here on.
  function turn({ file, recording, frames }) {
    stage.channel?.close();
    Object.assign(stage, { file, recording: `Recording:ispom:${recording}`, frames, given: -1, taken: 0, fault: undefined });
    feed(file, settling()).catch((fault) => {
      if (file !== stage.file) return;
      stage.fault = `What the views show cannot be loaded (${fault.message}).`;
      news();
    });
  }
  function settling() {
    return new Promise((done) => {
      let left = SETTLED_FRAMES;
      laidOut = () => {
        laidOut = () => {};
        afterFrames(() => --left <= 0 && (done() ?? true));
      };
    });
  }
  async function feed(file, settled) {
    const channel = handle.open_channel("run");
    stage.channel = channel;
    for await (const piece of pieces(await unpacked(addressOf(file)))) {
      if (file !== stage.file) return;
      channel.send_rrd(piece);
      if (++stage.given === 0) await settled; // a command before that would make an automatic layout
      news();
    }
  }
  return stage;
}

// Each piece begins with its size [bytes].
async function* pieces(stream) {
  let rest = new Uint8Array();
  for await (const chunk of chunksOf(stream)) {
    const all = new Uint8Array(rest.length + chunk.length);
    all.set(rest);
    all.set(chunk, rest.length);
    rest = all;
    while (rest.length >= 4) {
      const size = new DataView(rest.buffer, rest.byteOffset).getUint32(0);
      if (rest.length < 4 + size) break;
      yield rest.slice(4, 4 + size);
      rest = rest.subarray(4 + size);
    }
  }
}

async function* chunksOf(stream) {
  const reader = stream.getReader();
  for (let read = await reader.read(); !read.done; read = await reader.read()) yield read.value;
}
