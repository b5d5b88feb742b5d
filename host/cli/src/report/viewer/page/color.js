// Colours of layers, one 32-bit number for a pixel, as canvases store them on little-endian machines.

import { INVALID } from "viewer/codec.js";
import { depth } from "viewer/numbers.js";

const opaque = (r, g, b) => (255 << 24) | (b << 16) | (g << 8) | r;

export const ERROR_LIMIT = 4;
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
