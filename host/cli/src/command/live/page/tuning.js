// The controls of a match: they ask the server for disparities, and show them.

import { showMap, showScene } from "viewer/app.js";

const byId = (id) => document.getElementById(id);
const data = JSON.parse(byId("panel-data").textContent);
// How long after a wish the controls stay as they were set here.
const OWN_MS = 1000;
const UNSET = { off: "off", default: "default" };

// A control on the page: `value()` is its setting, undefined if it is not set.
class Control {
  constructor({ option, label, input, least, most, step, start, unset, values, value }, onChange) {
    this.option = option;
    this.node = document.createElement("div");
    const id = `option-${option}`;
    const add = (tag, properties, parent = this.node) => parent.appendChild(Object.assign(document.createElement(tag), properties));
    if (input === "slider") {
      this.node.className = "slider";
      const caption = add("label", { htmlFor: id });
      const output = add("output", { htmlFor: id });
      const range = add("input", { type: "range", id, min: least, max: most, step, value: start });
      const box = unset === "never" ? null : document.createElement("input");
      const isSet = () => !box || box.checked;
      const show = () => {
        output.textContent = isSet() ? range.value : UNSET[unset];
        this.node.classList.toggle("unset", !isSet());
        range.setAttribute("aria-valuetext", output.textContent);
      };
      if (box) {
        Object.assign(box, { type: "checkbox", id: `${id}-set`, ariaLabel: `Set ${label}` });
        caption.htmlFor = box.id;
        box.addEventListener("change", () => (show(), onChange()));
        caption.append(box);
        range.ariaLabel = label;
      }
      caption.append(label);
      // Whoever moves a slider wants its value.
      range.addEventListener("input", () => {
        if (box) box.checked = true;
        show();
        onChange();
      });
      this.value = () => (isSet() ? range.value : undefined);
      this.set = (text) => {
        if (box) box.checked = text !== undefined;
        if (text !== undefined) range.value = text;
        show();
      };
      show();
    } else if (input === "choice") {
      this.node.className = "line";
      add("label", { htmlFor: id, textContent: label });
      const select = add("select", { id });
      select.append(...values.map((each) => new Option(each, each)));
      select.addEventListener("change", onChange);
      this.value = () => select.value;
      this.set = (text) => (select.value = text ?? values[0]);
    } else {
      this.node.className = "line";
      const caption = add("label", { htmlFor: id, textContent: label });
      const box = add("input", { type: "checkbox", id });
      box.addEventListener("change", onChange);
      this.node.append(caption, box);
      this.value = () => (box.checked ? value : undefined);
      this.set = (text) => (box.checked = text !== undefined);
    }
  }
}

// The panel. `say` sends a wish to the server.
export class Tuning {
  constructor(say) {
    this.say = say;
    this.controls = data.controls.map((each) => new Control(each, () => this.ask()));
    const groups = new Map();
    data.controls.forEach(({ group }, i) => {
      if (!groups.has(group)) {
        const set = document.createElement("fieldset");
        set.append(Object.assign(document.createElement("legend"), { textContent: group }));
        groups.set(group, set);
      }
      groups.get(group).append(this.controls[i].node);
    });
    byId("groups").replaceChildren(...groups.values());
    this.groups = [...groups.values()];
    this.addRangeButton();
    byId("core").append(...data.processors.map(({ name, clock_mhz }) => new Option(`${name}, ${clock_mhz} MHz`, name)));
    byId("core").addEventListener("change", () => this.ask());
    byId("copy-command").addEventListener("click", () => copy("Command", byId("command").textContent));
    byId("copy-rust").addEventListener("click", () => copy("Rust", byId("rust").textContent));
    byId("tuning").addEventListener("submit", (event) => event.preventDefault());
  }

  control(option) {
    return this.controls.find((control) => control.option === option);
  }

  addRangeButton() {
    const line = Object.assign(document.createElement("div"), { className: "line" });
    this.rangeButton = Object.assign(document.createElement("button"), { type: "button", textContent: "Find the range", disabled: true });
    this.rangeButton.addEventListener("click", () => {
      this.control("min-disparity").set(String(this.found.min_disparity));
      this.control("num-disparities").set(String(this.found.num_disparities));
      this.ask();
    });
    line.append(this.rangeButton);
    this.control("num-disparities").node.after(line);
  }

  settings() {
    const set = this.controls.map(({ option, value }) => [option, value()]).filter(([, value]) => value !== undefined);
    return Object.fromEntries(set.sort(([a], [b]) => (a < b ? -1 : 1)));
  }

  // Asks for the match, once for each frame of the screen.
  ask() {
    this.asked ??= requestAnimationFrame(() => {
      this.asked = undefined;
      this.wished = JSON.stringify(this.settings());
      this.wishedAt = performance.now();
      this.say({ match: { settings: this.settings(), core: byId("core").value } });
    });
  }

  handlers() {
    return {
      scene: (contents) => this.takeScene(contents),
      plan: (contents) => this.takePlan(contents),
      progress: (contents) => this.takeProgress(contents),
      result: (contents) => this.takeResult(contents),
    };
  }

  async takeScene({ scene, folder, found_range }) {
    this.folder = folder;
    this.found = found_range;
    this.rangeButton.disabled = !found_range;
    await showScene(scene);
  }

  takePlan({ settings, applying, core, command, rust, prediction }) {
    // Another page may have set it. While a slider moves here, older wishes of this page come back.
    const isElsewhere = this.wished !== JSON.stringify(settings) && !(performance.now() - this.wishedAt < OWN_MS);
    if (isElsewhere) {
      this.wished = JSON.stringify(settings);
      this.controls.forEach((control) => control.set(settings[control.option]));
      byId("core").value = core;
    }
    this.controls.forEach((control) => {
      control.node.hidden = !applying.includes(control.option);
    });
    this.groups.forEach((group) => {
      group.hidden = [...group.querySelectorAll("div")].every((node) => node.hidden);
    });
    byId("command").textContent = command;
    byId("rust").textContent = rust;
    this.showPrediction(prediction);
    byId("failure").hidden = true;
  }

  showPrediction({ Ok: found, Err: refusal }) {
    byId("prediction-refusal").hidden = !refusal;
    byId("prediction-refusal").textContent = refusal ?? "";
    byId("prediction").hidden = !found;
    if (!found) return;
    const kilobytes = `${(found.ram_total / 1024).toFixed(found.ram_total < 102400 ? 1 : 0)} KiB`;
    const rate = found.fps === null ? "not predicted" : found.fps >= 1 ? `${found.fps.toFixed(1)} per second` : `one in ${(1 / found.fps).toFixed(1)} s`;
    const rows = [["RAM, without frames", kilobytes], ["Frames", rate], ["Size", `${found.width} × ${found.height}`]];
    const nodes = rows.flatMap(([name, value]) => [["dt", name], ["dd", value]].map(([tag, text]) => Object.assign(document.createElement(tag), { textContent: text })));
    byId("prediction").replaceChildren(...nodes);
  }

  takeProgress({ done, total, name }) {
    byId("progress").hidden = false;
    Object.assign(byId("progress"), { max: Math.max(total, 1), value: done });
    byId("state").textContent = `Matching: ${done} of ${total} ${name}`;
  }

  async takeResult({ folder, failure, summary, warnings, map, settings }) {
    byId("progress").hidden = true;
    byId("failure").hidden = !failure;
    if (failure) {
      byId("failure").textContent = failure;
      byId("state").textContent = "Not matched";
      return;
    }
    if (folder !== this.folder) return;
    await showMap(map);
    byId("state").textContent = summary.replaceAll(" %", "\u00a0%");
    byId("warnings").hidden = !warnings.length;
    byId("warnings").replaceChildren(...warnings.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
    // For tests, and for whoever listens: what these disparities were made by.
    window.dispatchEvent(new CustomEvent("matched", { detail: settings }));
    document.documentElement.dataset.viewer = "ready";
  }
}

async function copy(name, text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Without permission, as on addresses of other machines: by way of a selection.
    const area = Object.assign(document.createElement("textarea"), { value: text });
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  byId("copied").textContent = `${name} copied`;
}
