// Colours of layers, one 32-bit number for a pixel, as canvases store them on little-endian machines, and their scale.

import { INVALID, depth, depthText, metresText } from "viewer/numbers.js";

const byId = (id) => document.getElementById(id);

const opaque = (r, g, b) => (255 << 24) | (b << 16) | (g << 8) | r;

const ERROR_LIMIT = 4;
const UNKNOWN = opaque(128, 128, 128);
const NO_ESTIMATE = opaque(0, 170, 255);
const BLACK = opaque(0, 0, 0);

// The palette as 256 pixels.
export function ramp(palette) {
  return Int32Array.from({ length: 256 }, (_, i) => opaque(...palette.subarray(3 * i, 3 * i + 3)));
}

export function drawGray(gray, pixels) {
  for (let i = 0; i < gray.length; i++) pixels[i] = opaque(gray[i], gray[i], gray[i]);
}

export function drawDisparities(bits, [far, near], colors, pixels) {
  const factor = 255 / Math.max(near - far, 1 / 64);
  drawByTable(bits, (disparity) => colors[clamped((disparity - far) * factor)], pixels);
}

export function drawDepths(bits, [near, far], geometry, colors, pixels) {
  const factor = 255 / Math.max(far - near, 1e-6);
  const color = (disparity) => {
    const z = depth(disparity, geometry);
    return z === null ? BLACK : colors[clamped((far - z) * factor)];
  };
  drawByTable(bits, color, pixels);
}

const clamped = (place) => Math.min(255, Math.max(0, Math.round(place)));

// Looks up the colours of all disparities that there can be: there are fewer than pixels in a picture.
function drawByTable(bits, color, pixels) {
  const table = new Int32Array(65536).fill(BLACK);
  for (let value = INVALID + 1; value <= 32767; value++) table[value & 0xffff] = color(value / 64);
  for (let i = 0; i < bits.length; i++) pixels[i] = table[bits[i] & 0xffff];
}

export function drawConfidences(confidences, bits, colors, pixels) {
  for (let i = 0; i < bits.length; i++) pixels[i] = bits[i] === INVALID ? BLACK : colors[confidences[i]];
}

export function drawErrors(bits, truth, colors, pixels) {
  for (let i = 0; i < bits.length; i++) {
    const error = Math.round((Math.abs(bits[i] - truth[i]) * 255) / (64 * ERROR_LIMIT));
    pixels[i] = truth[i] === INVALID ? UNKNOWN : bits[i] === INVALID ? NO_ESTIMATE : colors[error > 255 ? 255 : error];
  }
}

// The colour scale: a bar with marks, whose ends can be dragged where it shows disparities or depths.
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
