import { CameraPanel } from "live/camera.js";
import { Link } from "live/link.js";
import { Tuning } from "live/tuning.js";

const say = (message) => link.say(message);
const tuning = new Tuning(say);
const camera = document.getElementById("camera") ? new CameraPanel(say) : undefined;
const link = new Link({ ...tuning.handlers(), ...camera?.handlers() }, (isThere, reason) => {
  const state = document.getElementById("state");
  state.textContent = isThere ? "Connected" : `The link to the program has ended. ${reason}`;
  document.documentElement.dataset.link = isThere ? "there" : "gone";
});
