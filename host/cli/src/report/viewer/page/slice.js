// The epipolar slice of a sweep: a row of all frames, one below the other by their places. A surface is a stripe in it, the steeper
// the farther it is, and one that is hidden ends where another crosses it.

import { INVALID, px } from "viewer/numbers.js";

const byId = (id) => document.getElementById(id);
// The height of a frame's line, in pixels.
const LINE = 6;

// The frames of a scene from the left to the right, the centre among them.
const placed = ({ frames, sweep }) => [{ place: 0, gray: frames[0].gray }, ...sweep].toSorted((a, b) => a.place - b.place);

// The columns at which the frames see what the centre sees at a column, with a disparity in pixels.
export const stripe = (scene, u, disparity) => placed(scene).map(({ place }) => u - place * disparity);

// Draws the slice of the cursor's row, with the stripe that the map has there, and a mark at the step that is shown.
export function showSlice(scene, [u, v], map, step) {
  for (const id of ["slice-title", "slice", "slice-help"]) byId(id).hidden = !scene.sweep.length;
  if (!scene.sweep.length) return;
  const lines = placed(scene);
  const canvas = Object.assign(byId("slice"), { width: scene.width, height: LINE * lines.length });
  const context = canvas.getContext("2d");
  const image = context.createImageData(scene.width, canvas.height);
  for (let y = 0; y < canvas.height; y++) {
    const { gray } = lines[Math.floor(y / LINE)];
    for (let x = 0; x < scene.width; x++) image.data.set([gray[v * scene.width + x], gray[v * scene.width + x], gray[v * scene.width + x], 255], 4 * (y * scene.width + x));
  }
  context.putImageData(image, 0, 0);
  const middle = (line) => LINE * (line + 0.5);
  const bits = map?.bits[v * scene.width + u] ?? INVALID;
  const text = bits === INVALID ? "no disparity" : `${px(bits / 64)} pixels`;
  canvas.setAttribute("aria-label", `Epipolar slice of row ${v}: ${lines.length} frames from the left to the right; ${text} at column ${u}`);
  byId("slice-title").textContent = `Row ${v} in all frames`;
  for (const [color, width] of [["#000", 4], ["#fff", 1.5]]) {
    Object.assign(context, { strokeStyle: color, lineWidth: width });
    context.beginPath();
    if (bits !== INVALID) stripe(scene, u, bits / 64).forEach((x, line) => context.lineTo(x + 0.5, middle(line)));
    const shown = middle(lines.indexOf(scene.sweep[step]));
    context.moveTo(0, shown);
    context.lineTo(2 * LINE, shown);
    context.stroke();
  }
}
