// Calls `look` after each frame that the browser draws, until it says that it saw enough. The viewer asks for a frame in
// the frame before, so this one has been drawn by it then, if it draws at all: the only time at which its picture can be
// read.
export function afterFrames(look) {
  requestAnimationFrame(() => look() || afterFrames(look));
}
