// The run's stream: `.rrd` bytes from the server, as fast as the viewer takes them in. The viewer holds one frame, the one
// that is shown: images, tracks and maps of another replace them. The server sends the frame that the page shows, with its state;
// the page says when it can take another one.
// Each message ends with a serial number that the viewer's state tells when it has taken the message in: so the page
// always knows which frame the views show, and leaves out frames where the viewer is slow. Another run is another channel.
const LONGEST_PAUSE_MS = 700;
const HEAD_BYTES = 12;

// `send` gives a message to the server; `news` is called when the views may show something else; `parting` before the viewer gets
// anything of another run, and awaited: the viewer shows that run from its first byte on, and has nothing to draw of it for a
// while.
export function feedLive(handle, send, news, parting) {
  const stage = {
    run: "",
    channel: null, // of the viewer, for the run
    recording: null, // id of the run's, in the viewer
    shown: null, // { recording, index, complete } that the views show
    unread: [], // messages that the viewer has not taken in yet
    serial: 0,
    asked: false, // whether the server knows that the viewer can take a frame
    hurried: true, // whether somebody waits for the frame
    givenAt: 0, // when the viewer was given the last message
    dueAt: 0, // when it may get another one
    pause: null, // timer until then
  };
  stage.want = (_, hurried) => {
    if (stage.hurried === hurried) return;
    stage.hurried = hurried;
    ask(stage, send);
  };
  stage.heard = (serialOf) => heard(stage, serialOf, send);
  // There is a new line to the server, which knows nothing of this page.
  stage.connected = () => {
    stage.asked = false;
    ask(stage, send);
  };
  let given = Promise.resolve(); // one message after the other
  const give = async (data) => {
    if (data instanceof ArrayBuffer) take(stage, data);
    else {
      if (stage.run) await parting();
      begin(stage, handle, data);
    }
    news();
  };
  stage.streamed = (data) => {
    given = given.then(() => give(data));
  };
  stage.connected();
  return stage;
}

function begin(stage, handle, { run, recording }) {
  stage.channel?.close();
  Object.assign(stage, { run, recording: `Recording:ispom:${recording}`, channel: handle.open_channel("run") });
}

function take(stage, data) {
  const head = new DataView(data);
  stage.serial = head.getUint32(0);
  const [index, complete] = [head.getUint32(4), head.getUint8(8) !== 0];
  stage.unread.push({ serial: stage.serial, recording: stage.recording, index, complete });
  stage.asked = false;
  stage.givenAt = performance.now();
  stage.channel.send_rrd(new Uint8Array(data, HEAD_BYTES));
}

// Messages that the viewer has taken in are drawn. `serialOf` gives the last one of a recording, null where there is none.
function heard(stage, serialOf, send) {
  const isRead = ({ serial, recording }) => serial <= (serialOf(recording) ?? (recording === stage.recording ? -1 : Infinity));
  while (stage.unread.length && isRead(stage.unread[0])) {
    const { recording, index, complete } = stage.unread.shift();
    stage.shown = { recording, index, complete };
    const now = performance.now();
    stage.dueAt = now + Math.min(now - stage.givenAt, LONGEST_PAUSE_MS);
    ask(stage, send);
  }
}

// The server sends no other frame until the viewer has taken in the one before. Where graphics are software, a frame of the viewer
// takes as long as a frame's computation. So while nobody waits (the run plays), the viewer gets nothing for as long as it took
// for the last frame: half of the processor is left for the run.
function ask(stage, send) {
  clearTimeout(stage.pause);
  const { unread, asked, run, serial, dueAt, hurried } = stage;
  const left = hurried ? 0 : dueAt - performance.now();
  if (unread.length || asked) return;
  if (left > 0) stage.pause = setTimeout(() => ask(stage, send), left);
  else stage.asked = send({ do: "ready", run, serial });
}
