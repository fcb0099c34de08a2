// Rerun's experimental Viewer Control API, as far as we need it: one protobuf message, written by hand.
//   ViewerControlRequest.set_time_cursor = 6 { timeline = 2 { name = 1 }, time = 3 { value = 1 }, play_state = 5 }
export const PAUSED = 1;
export const FOLLOWING = 3;

export function setTimeCursor(timeline, time, playState) {
  const name = field(1, new TextEncoder().encode(timeline));
  const parts = [field(2, name)];
  if (time !== null) parts.push(field(3, number(1, time)));
  parts.push(number(5, playState));
  return field(6, join(parts));
}

const join = (parts) => Uint8Array.from(parts.flatMap((part) => [...part]));
const number = (tag, value) => Uint8Array.from([tag << 3, ...varint(value)]);
const field = (tag, bytes) => Uint8Array.from([(tag << 3) | 2, ...varint(bytes.length), ...bytes]);

function varint(value) {
  const bytes = [];
  while (value > 127) {
    bytes.push((value % 128) | 128);
    value = Math.floor(value / 128);
  }
  return [...bytes, value];
}
