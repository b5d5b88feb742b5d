// Decodes what the program encoded: planes of numbers, each predicted from its neighbours and deflated.

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
