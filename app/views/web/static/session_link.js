// The page's line to the session: commands go out, states and frames come in. A published page has its own session
// (published_session.js).

// `opened` is called when there is a line, `heard` with each state, `streamed` with what the viewer is to show (live.js), `lost`
// when the line is gone.
export function openSocket({ opened, heard, streamed, lost }) {
  let socket;
  const connect = () => {
    socket = new WebSocket(new URL("ws", document.baseURI).href.replace("http", "ws"));
    socket.binaryType = "arraybuffer";
    socket.onopen = opened;
    socket.onmessage = ({ data }) => {
      if (typeof data !== "string") return streamed(data);
      const message = JSON.parse(data);
      if (message.begins) streamed(message.begins);
      else heard(message);
    };
    socket.onclose = () => {
      lost();
      setTimeout(reconnect, 1000);
    };
  };
  // A failed WebSocket is an error in the console, a failed fetch as well: so few tries, and only while someone looks.
  const reconnect = () => {
    if (document.visibilityState === "visible") connect();
    else document.addEventListener("visibilitychange", connect, { once: true });
  };
  return {
    open: connect,
    // What the server answers at an address below the page's own, as JSON; null where it does not.
    answer: (address) =>
      fetch(address).then(
        (found) => (found.ok ? found.json() : null),
        () => null,
      ),
    // Whether there was a line to send the message on.
    send(message) {
      const isOpen = socket?.readyState === WebSocket.OPEN;
      if (isOpen) socket.send(JSON.stringify(message));
      return isOpen;
    },
  };
}
