// Numbers: as the program encoded them, planes that are each predicted from its neighbours and deflated, and as they are read.

// A loop, since `Uint8Array.from` with a function takes seconds for the pictures of a large rig.
function decoded(text) {
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return bytes;
}

async function inflate(text) {
  const bytes = decoded(text);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The predictor of LOCO-I: the median of left, above, and the plane through all three neighbours.
function undoPrediction(values, width) {
  for (let i = 0; i < values.length; i++) {
    const isFirst = i % width === 0;
    const left = isFirst ? (i < width ? 0 : values[i - width]) : values[i - 1];
    const above = i < width ? left : values[i - width];
    const corner = isFirst || i < width ? above : values[i - width - 1];
    const [low, high] = left < above ? [left, above] : [above, left];
    values[i] += corner >= high ? low : corner <= low ? high : left + above - corner;
  }
  return values;
}

export const INVALID = -32768;

// 8-bit grey values or confidences.
export async function bytes(text, width) {
  return undoPrediction(await inflate(text), width);
}

// Disparities in 1/64 px, INVALID where there is none: all low bytes, then all high bytes.
export async function disparities(text, width) {
  const parts = await inflate(text);
  const count = parts.length / 2;
  const values = new Int16Array(count);
  for (let i = 0; i < count; i++) values[i] = parts[i] | (parts[count + i] << 8);
  return undoPrediction(values, width);
}

// Three bytes for each of 256 colours.
export function palette(text) {
  return decoded(text);
}

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
