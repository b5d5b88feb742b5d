// Numbers as they are read.

import { INVALID } from "viewer/codec.js";

// The depth in metres of a disparity in pixels, or null if there is none.
export function depth(pixels, geometry) {
  const shift = pixels + (geometry?.doffs ?? 0);
  return geometry && shift > 0 ? (geometry.focal_px * geometry.baseline_mm) / shift / 1000 : null;
}

export function depthText(pixels, geometry) {
  const metres = depth(pixels, geometry);
  return metres === null ? "∞" : metresText(metres);
}

export const metresText = (metres) => `${metres < 10 ? metres.toFixed(3) : metres.toFixed(1)} m`;

export const pixels = (bits) => (bits === INVALID ? null : bits / 64);
export const px = (value, digits = 2) => (value === null || value === undefined ? "–" : value.toFixed(digits));
export const percent = (value) => (value === null || value === undefined ? "–" : `${(100 * value).toFixed(0)} %`);

// The point that a pixel sees, in metres: x to the right, y down, z along the optical axis.
export function point(u, v, bits, geometry) {
  const z = bits === INVALID ? null : depth(bits / 64, geometry);
  if (z === null) return null;
  const [cx, cy] = geometry.principal_point;
  return [((u - cx) * z) / geometry.focal_px, ((v - cy) * z) / geometry.focal_px, z];
}
