import { CameraPanel } from "live/camera.js";
import { Tuning } from "live/tuning.js";

// The link to the server: notices come in, wishes go out.
class Link {
  // `handlers` take the contents of notices by subject. `onState` is told whether the link is there, and why not.
  constructor(handlers, onState) {
    this.handlers = handlers;
    this.onState = onState;
    this.waiting = new Map();
    this.isBusy = false;
    this.connect();
  }

  connect() {
    const address = new URL("socket", window.location.href);
    address.protocol = address.protocol.replace("http", "ws");
    this.socket = new WebSocket(address);
    this.socket.addEventListener("open", () => this.onState(true, ""));
    this.socket.addEventListener("close", (event) => this.onState(false, event.reason));
    this.socket.addEventListener("message", (event) => {
      const { subject, contents } = JSON.parse(event.data);
      // What is newer replaces what nobody has looked at yet.
      this.waiting.set(subject, contents);
      this.handle();
    });
  }

  // One notice after the other, since to decode one takes a while.
  async handle() {
    if (this.isBusy) return;
    this.isBusy = true;
    while (this.waiting.size) {
      const [subject, contents] = this.waiting.entries().next().value;
      this.waiting.delete(subject);
      await this.handlers[subject]?.(contents);
    }
    this.isBusy = false;
  }

  say(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}

const say = (message) => link.say(message);
const tuning = new Tuning(say);
const camera = document.getElementById("camera") ? new CameraPanel(say) : undefined;
const link = new Link({ ...tuning.handlers(), ...camera?.handlers() }, (isThere, reason) => {
  const state = document.getElementById("state");
  state.textContent = isThere ? "Connected" : `The link to the program has ended. ${reason}`;
  document.documentElement.dataset.link = isThere ? "there" : "gone";
});
