// The page's line to the session: commands go out, states come in. A published page has its own session (published_session.js).

// `opened` is called when there is a line, `heard` with each state, `lost` when the line is gone.
export function openSocket({ opened, heard, lost }) {
  let socket;
  const connect = () => {
    socket = new WebSocket(new URL("ws", document.baseURI).href.replace("http", "ws"));
    socket.onopen = opened;
    socket.onmessage = ({ data }) => heard(JSON.parse(data));
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
    send: (message) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message)),
  };
}
