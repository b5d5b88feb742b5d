// What is under the cursor: disparity, depth, confidence and error of every map, and the costs of the chosen one.

import { costsAt, explanation } from "viewer/costs.js";
import { INVALID, depth, percent, pixels, px } from "viewer/numbers.js";
import { costChart } from "viewer/plots.js";

const byId = (id) => document.getElementById(id);

// Everything that is known of a pixel.
export function valuesAt(scene, [u, v]) {
  const i = v * scene.width + u;
  const known = scene.truth && scene.truth[i] !== INVALID;
  const maps = scene.maps.map((map) => {
    const disparity = pixels(map.bits[i]);
    return {
      name: map.name,
      disparity,
      depth: disparity === null ? null : depth(disparity, scene.geometry),
      confidence: map.confidences && disparity !== null ? map.confidences[i] / 255 : null,
      error: known && disparity !== null ? (map.bits[i] - scene.truth[i]) / 64 : null,
    };
  });
  const truth = known ? scene.truth[i] / 64 : null;
  return { maps, truth, gray: scene.frames[0]?.gray[i] ?? null };
}

export function showReadout(scene, cursor, map) {
  const { maps, truth, gray } = valuesAt(scene, cursor);
  const [u, v] = cursor;
  byId("place").textContent = `Pixel (${u}, ${v})${gray === null ? "" : `, grey ${gray}`}`;
  const hasConfidences = scene.maps.some((each) => each.confidences);
  const columns = ["map", "px", ...(scene.geometry ? ["depth m"] : []), ...(hasConfidences ? ["sure"] : []), ...(scene.truth ? ["error px"] : [])];
  const cells = (row) => [
    row.name,
    px(row.disparity),
    ...(scene.geometry ? [px(row.depth, 3)] : []),
    ...(hasConfidences ? [percent(row.confidence)] : []),
    ...(scene.truth ? [px(row.error)] : []),
  ];
  const rows = maps.map(cells);
  if (truth !== null) rows.push(cells({ name: "truth", disparity: truth, depth: depth(truth, scene.geometry), confidence: null, error: null }));
  byId("values").replaceChildren(row(columns, "th"), ...rows.map((each) => row(each, "td")));
  const current = maps[scene.maps.indexOf(map)];
  if (current) {
    const metres = current.depth === null ? "" : `, ${current.depth.toFixed(3)} metres`;
    byId("spoken").textContent = `Column ${u}, row ${v}: ${current.disparity === null ? "no disparity" : `${px(current.disparity)} pixels`}${metres}`;
  }
  showCosts(scene, cursor, map, current);
}

function row(cells, tag) {
  const line = document.createElement("tr");
  cells.forEach((text, column) => {
    const cell = document.createElement(tag);
    cell.textContent = text;
    if (tag === "th") cell.scope = "col";
    if (column > 0) cell.className = "number";
    line.append(cell);
  });
  return line;
}

function whyNoCosts({ frames, left_out, sweep }) {
  if (sweep.length) return "No costs: each frame of a sweep refines what those before it found.";
  if (left_out.includes("neighbors")) return "No costs: the neighbours' pictures are left out, to keep the page small.";
  if (frames.length > 1) return "No costs: the pictures are at other baselines than the disparities.";
  return "No costs: they are computed from the pictures of a rig, which are not part of this page.";
}

function showCosts(scene, cursor, map, current) {
  const costs = map?.costs;
  if (!costs) {
    byId("costs-title").textContent = "";
    byId("costs").replaceChildren();
    byId("fused").textContent = map ? whyNoCosts(scene) : "";
    return;
  }
  const found = costsAt(scene, costs, cursor);
  const block = `${costs.block_size} × ${costs.block_size}`;
  byId("costs-title").textContent = `Costs of block matching, ${block}, fused by ${costs.fusion}`;
  byId("costs").replaceChildren(...costChart(found, current?.disparity ?? null));
  const other = costs.exact ? "" : ` These are the costs of block matching, not of ${map.name}.`;
  byId("fused").textContent = explanation(found, costs.fusion) + other;
}
