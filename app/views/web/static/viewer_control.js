// Rerun's experimental Viewer Control API, as far as it is needed: protobuf messages by field number, as in
// viewer_control.proto of Rerun 0.41 (rerun.viewer_control.v1alpha1). The documented class WebViewer has methods for all
// of them (set_time, close, set_blueprint, get_state); why it is not used: see rerun_assets.py.
const CLOSE = 1,
  SET_TIME_CURSOR = 6,
  SET_BLUEPRINT = 14; // of ViewerControlRequest
const STAGE = "stage"; // timeline of the recordings: the serial number of the message that was taken in last
const FRAMES = "exposure"; // timeline of the frames, in recordings that hold them all
const PAUSED = 1;
const PARTIAL = 2;

// Has a recording drawn again. All that is drawn is static: the time cursor, which is put to its beginning, changes nothing.
export const redraw = (store) =>
  request(SET_TIME_CURSOR, [text(1, store), bytes(2, text(1, STAGE)), bytes(3, number(1, 0)), number(5, PAUSED)]);

// Shows a frame of a recording that has all of them.
export const showFrame = (store, index) =>
  request(SET_TIME_CURSOR, [text(1, store), bytes(2, text(1, FRAMES)), bytes(3, number(1, index)), number(5, PAUSED)]);

export const closeRecordings = (stores) =>
  request(CLOSE, [
    bytes(
      3,
      stores.flatMap((store) => text(1, store)),
    ),
  ]);

// Changes these components of the layout that a recording is shown in, and nothing else.
export const updateBlueprint = (store, entities) =>
  request(SET_BLUEPRINT, [text(2, JSON.stringify(entities)), bytes(3, text(1, store)), number(5, PARTIAL)]);

// GetStateResponse: the recording on the screen, and of each recording the serial number of the message that it took in last.
export function stateOf(message) {
  const state = fields(message);
  const recordings = (state[3] ?? []).map((recording) => recordingOf(fields(recording)));
  return { active: string(state[2]), recordings };
}

function recordingOf(recording) {
  const range = (recording[2] ?? []).map(fields).find((each) => string(nested(each[1])[1]) === STAGE)?.[3];
  return { id: string(recording[1]), serial: range ? integer(nested(range)[2]) : 0 };
}

// The wire format. Messages are small: plain arrays of bytes will do.
const request = (kind, parts) => Uint8Array.from(bytes(kind, parts.flat()));
const number = (tag, value) => [...varint(tag << 3), ...varint(value)];
const bytes = (tag, content) => [...varint((tag << 3) | 2), ...varint(content.length), ...content];
const text = (tag, value) => bytes(tag, [...new TextEncoder().encode(value)]);

function varint(value) {
  const found = [];
  while (value > 127) {
    found.push((value % 128) | 128);
    value = Math.floor(value / 128);
  }
  return [...found, value];
}

// By field number, all values of a message.
function fields(message) {
  const found = {};
  let at = 0;
  const next = () => {
    let value = 0;
    for (let factor = 1; ; factor *= 128) {
      const byte = message[at++];
      value += (byte & 127) * factor;
      if (byte < 128) return value;
    }
  };
  const take = (length) => message.subarray(at, (at += length));
  while (at < message.length) {
    const key = next();
    const kind = key & 7;
    (found[Math.floor(key / 8)] ??= []).push(kind === 0 ? next() : take(kind === 2 ? next() : kind === 1 ? 8 : 4));
  }
  return found;
}

const nested = (values) => (values ? fields(values[0]) : {});
const string = (values) => (values ? new TextDecoder().decode(values[0]) : null);
const integer = (values) => values?.[0] ?? 0;
