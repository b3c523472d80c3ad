// The program's server. Verbs that are sent while it is lost are dropped: the page says so.
import { answeredBy, receive, update } from "./store.js";

let socket = null;

const server = {
  send(verb) {
    if (socket?.readyState !== WebSocket.OPEN) return false;
    socket.send(JSON.stringify(verb));
    return true;
  },
  load: (key) => fetch(`/blob/${key}`).then((reply) => (reply.ok ? reply.arrayBuffer() : null)),
  address: (path) => path,
};

export function connect() {
  answeredBy(server);
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
  socket.onmessage = (event) => receive(JSON.parse(event.data));
  socket.onclose = () => {
    update({ connection: "lost" });
    setTimeout(connect, 1000);
  };
}
