// The colour scale: a bar with marks, whose ends can be dragged where it shows disparities or depths.

import { ERROR_LIMIT } from "viewer/color.js";
import { depthText, metresText } from "viewer/numbers.js";

const byId = (id) => document.getElementById(id);

export class Scale {
  constructor(palettes, onChange) {
    this.palettes = palettes;
    this.inputs = [byId("lower"), byId("upper")];
    // What can be dragged, by kind: the range of the colours, and the limits of its ends.
    this.ranges = {};
    this.limits = {};
    for (const input of this.inputs) {
      input.addEventListener("input", () => {
        const [lower, upper] = this.inputs.map((each) => Number(each.value));
        const step = Number(input.step);
        this.isDragged = true;
        // The ends push each other along.
        this.ranges[this.kind] = input === this.inputs[0] ? [lower, Math.max(upper, lower + step)] : [Math.min(lower, upper - step), upper];
        this.show();
        onChange();
      });
    }
  }

  // The ranges of disparities in pixels and, if they are known, of depths in metres.
  reset(ranges, geometry) {
    this.isDragged = false;
    this.geometry = geometry;
    const least = { disparity: 1, depth: 0.001 };
    this.ranges = Object.fromEntries(Object.entries(ranges).map(([kind, [from, to]]) => [kind, [from, Math.max(to, from + least[kind] / 64)]]));
    this.limits = Object.fromEntries(Object.entries(this.ranges).map(([kind, range]) => [kind, rounded(range, least[kind])]));
    this.show();
  }

  of(kind) {
    this.kind = kind;
    this.show();
  }

  text(value) {
    if (this.kind === "depth") return metresText(value);
    return `${Number(value.toFixed(1))} px${this.geometry ? `\n${depthText(value, this.geometry)}` : ""}`;
  }

  show() {
    const { kind } = this;
    const range = this.ranges[kind];
    byId("scale").hidden = !kind || kind === "picture";
    if (byId("scale").hidden) return;
    for (const [i, input] of this.inputs.entries()) {
      input.hidden = !range;
      if (!range) continue;
      const [min, max] = this.limits[kind];
      Object.assign(input, { min, max, step: (max - min) / 400, value: range[i] });
      input.ariaLabel = `${(i === 0) === (kind === "depth") ? "Near" : "Far"} end of the colours`;
      input.ariaValueText = this.text(range[i]).replace("\n", ", ");
    }
    const titles = {
      disparity: () => `Disparity: ${range[0].toFixed(1)} to ${range[1].toFixed(1)} px. Red is near, black is none. Drag the ends.`,
      depth: () => `Depth: ${metresText(range[0])} to ${metresText(range[1])}. Red is near, black is none. Drag the ends.`,
      confidence: () => "Confidence: the probability that a disparity is at most one pixel off. Black is none.",
      error: () => "Error against the truth. Blue: no disparity. Grey: truth unknown.",
    };
    byId("scale-title").textContent = titles[kind]();
    this.paint();
    this.mark();
  }

  paint() {
    const { kind } = this;
    const [range, limits] = [this.ranges[kind], this.limits[kind]];
    const context = byId("ramp").getContext("2d");
    const image = context.createImageData(256, 1);
    const pixels = new Int32Array(image.data.buffer);
    for (let i = 0; i < 256; i++) {
      const value = range && limits[0] + ((limits[1] - limits[0]) * i) / 255;
      const place = range ? Math.round((255 * (value - range[0])) / (range[1] - range[0])) : i;
      const clamped = Math.min(255, Math.max(0, place));
      // Depths are small where disparities are large.
      pixels[i] = this.palettes[kind][kind === "depth" ? 255 - clamped : clamped];
    }
    context.putImageData(image, 0, 0);
  }

  mark() {
    const { kind } = this;
    const limits = this.limits[kind];
    const texts = {
      error: (share) => `${share * ERROR_LIMIT}${share === 1 ? "+" : ""} px`,
      confidence: (share) => `${100 * share} %`,
    };
    const text = texts[kind] ?? ((share) => this.text(limits[0] + share * (limits[1] - limits[0])));
    const marks = [0, 0.25, 0.5, 0.75, 1].map((share) => Object.assign(document.createElement("span"), { textContent: text(share) }));
    byId("ticks").replaceChildren(...marks);
  }
}

// A range whose ends are moved outwards to round numbers, at least `least` apart.
function rounded([from, to], least) {
  const unit = Math.max(least, 10 ** Math.floor(Math.log10(to - from) - 1));
  const lower = Math.floor(from / unit) * unit;
  return [lower, Math.max(Math.ceil(to / unit) * unit, lower + unit)];
}
