// The colour scale: a bar with marks in pixels and metres, whose ends can be dragged.

import { ERROR_LIMIT } from "viewer/color.js";
import { depthText } from "viewer/numbers.js";

const byId = (id) => document.getElementById(id);

export class Scale {
  constructor(palettes, onChange) {
    this.palettes = palettes;
    this.inputs = [byId("far"), byId("near")];
    this.range = [0, 1];
    for (const input of this.inputs) {
      input.addEventListener("input", () => {
        const [far, near] = this.inputs.map((each) => Number(each.value));
        const step = Number(input.step);
        this.isDragged = true;
        // The ends push each other along.
        this.range = input === this.inputs[0] ? [far, Math.max(near, far + step)] : [Math.min(far, near - step), near];
        this.show();
        onChange();
      });
    }
  }

  // The limits between which the ends can be dragged.
  reset(least, greatest, geometry) {
    this.isDragged = false;
    this.geometry = geometry;
    const [from, to] = [Math.floor(least), Math.max(Math.ceil(greatest), Math.floor(least) + 1)];
    for (const input of this.inputs) Object.assign(input, { min: from, max: to, step: (to - from) / 400 });
    this.range = [least, Math.max(greatest, least + 1 / 64)];
    this.limits = [from, to];
    this.show();
  }

  of(kind) {
    this.kind = kind;
    this.show();
  }

  show() {
    const { kind, limits, range } = this;
    byId("scale").hidden = !kind || kind === "picture";
    if (byId("scale").hidden || !limits) return;
    const isDisparity = kind === "disparity";
    for (const [i, input] of this.inputs.entries()) {
      input.hidden = !isDisparity;
      input.value = range[i];
      input.setAttribute("aria-valuetext", `${range[i].toFixed(1)} pixels${this.geometry ? `, ${depthText(range[i], this.geometry)}` : ""}`);
    }
    const titles = {
      disparity: `Disparity: ${range[0].toFixed(1)} to ${range[1].toFixed(1)} px. Red is near, black is none. Drag the ends.`,
      confidence: "Confidence: the probability that a disparity is at most one pixel off. Black is none.",
      error: "Error against the truth. Blue: no disparity. Grey: truth unknown.",
    };
    byId("scale-title").textContent = titles[kind];
    this.paint(isDisparity);
    this.mark(isDisparity);
  }

  paint(isDisparity) {
    const ramp = byId("ramp");
    const context = ramp.getContext("2d");
    const image = context.createImageData(256, 1);
    const pixels = new Int32Array(image.data.buffer);
    const colors = this.palettes[this.kind];
    const [from, to] = this.limits;
    for (let i = 0; i < 256; i++) {
      const value = from + ((to - from) * i) / 255;
      const place = isDisparity ? (255 * (value - this.range[0])) / (this.range[1] - this.range[0]) : i;
      pixels[i] = colors[Math.min(255, Math.max(0, Math.round(place)))];
    }
    context.putImageData(image, 0, 0);
  }

  mark(isDisparity) {
    const marks = [0, 0.25, 0.5, 0.75, 1].map((share) => {
      const mark = document.createElement("span");
      if (isDisparity) {
        const value = this.limits[0] + share * (this.limits[1] - this.limits[0]);
        mark.textContent = `${Number(value.toFixed(1))} px${this.geometry ? `\n${depthText(value, this.geometry)}` : ""}`;
      } else {
        const atEnd = share === 1 ? "+" : "";
        mark.textContent = this.kind === "error" ? `${share * ERROR_LIMIT}${atEnd} px` : `${100 * share} %`;
      }
      return mark;
    });
    byId("ticks").replaceChildren(...marks);
  }
}
