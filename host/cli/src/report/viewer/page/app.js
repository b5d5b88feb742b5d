// The viewer: it decodes scenes, those of the page or of a server, and shows them.

import { Scale, drawConfidences, drawDepths, drawDisparities, drawErrors, drawGray, ramp } from "viewer/color.js";
import { costsAt } from "viewer/costs.js";
import { Cloud } from "viewer/cloud.js";
import { INVALID, bytes, depth, disparities, palette } from "viewer/numbers.js";
import { Panes } from "viewer/panes.js";
import { sceneCharts } from "viewer/plots.js";
import { showReadout, valuesAt } from "viewer/readout.js";
import { showSlice, stripe } from "viewer/slice.js";

const byId = (id) => document.getElementById(id);
const page = JSON.parse(byId("viewer-data").textContent);
const palettes = Object.fromEntries(Object.entries(page.palettes).map(([kind, text]) => [kind, ramp(palette(text))]));
palettes.depth = palettes.disparity;
const BLINK_MS = 700;
// The share of a range that is left free beyond its far end: the first colours are almost black, which is no disparity.
const FAR_ROOM = 0.06;

let scene = null;
let blinkTimer = 0;
let isSwapped = false;
const choice = { first: null, second: null };

const scale = new Scale(palettes, () => {
  scene.layers.forEach((layer) => {
    if (layer.kind === scale.kind) layer.canvas = null;
  });
  update();
});
const panes = new Panes([byId("pane-first"), byId("pane-second")], {
  onCursor: () => showPixel(),
  onDivide: (percent) => divide(percent),
  onSwap: () => swap(),
});
const cloud = new Cloud(byId("cloud"), (places) => {
  byId("measured").textContent = measurement(places);
});

const mode = () => document.querySelector("input[name=mode]:checked").value;
// The step of a sweep that is shown.
const step = () => Number(byId("step").value);
const layerOf = (id) => scene.layers.find((layer) => layer.id === id);
// The map whose costs are shown: the first that is on show, else the best.
const currentMap = () => layerOf(choice.first)?.map ?? layerOf(choice.second)?.map ?? scene.maps[0];

// Shows the values and the slice at the cursor.
function showPixel() {
  if (!panes.cursor) return;
  showReadout(scene, panes.cursor, currentMap());
  showSlice(scene, panes.cursor, layerOf(choice.first)?.id === "sweep-map" ? scene.sweep[step()] : currentMap(), step());
}

async function decodeMap(raw, width) {
  return {
    ...raw,
    bits: await disparities(raw.disparities, width),
    confidences: raw.confidences && (await bytes(raw.confidences, width)),
  };
}

async function decode(raw) {
  const [width, height] = raw.size;
  const frames = await Promise.all(raw.frames.map(async (frame) => ({ ...frame, gray: await bytes(frame.gray, width) })));
  const maps = await Promise.all(raw.maps.map((map) => decodeMap(map, width)));
  if (maps.every((map) => map.metrics)) maps.sort((a, b) => a.metrics.avg_err - b.metrics.avg_err);
  const truth = raw.truth && (await disparities(raw.truth, width));
  const sweep = await Promise.all(raw.sweep.map(async (step) => ({ ...step, gray: await bytes(step.gray, width), bits: await disparities(step.disparities, width) })));
  let color = null;
  if (raw.color) {
    color = new Image();
    color.src = raw.color;
    await color.decode();
  }
  const decoded = { ...raw, width, height, frames, maps, truth, sweep, color };
  decoded.layers = layersOf(decoded);
  return decoded;
}

function layersOf({ frames, maps, truth, sweep, geometry }) {
  const layers = [];
  maps.forEach((map, k) => layers.push({ id: `disparity-${k}`, name: map.name, group: "Disparity", kind: "disparity", map, bits: map.bits }));
  if (truth) layers.push({ id: "truth", name: "truth", group: "Disparity", kind: "disparity", bits: truth });
  if (geometry) maps.forEach((map, k) => layers.push({ id: `depth-${k}`, name: `depth by ${map.name}`, group: "Depth", kind: "depth", map, bits: map.bits }));
  if (geometry && truth) layers.push({ id: "depth-truth", name: "true depth", group: "Depth", kind: "depth", bits: truth });
  frames.forEach((frame, k) => layers.push({ id: `frame-${k}`, name: frame.name, group: "Pictures", kind: "picture", frame }));
  maps.filter((map) => map.confidences).forEach((map) => {
    layers.push({ id: `confidence-${maps.indexOf(map)}`, name: `confidence of ${map.name}`, group: "Confidence", kind: "confidence", map });
  });
  if (truth) maps.forEach((map, k) => layers.push({ id: `error-${k}`, name: `error of ${map.name}`, group: "Errors", kind: "error", map }));
  if (sweep.length) {
    const last = sweep.at(-1);
    layers.push({ id: "sweep-map", name: "filter, frame by frame", group: "Sweep", kind: "disparity", bits: last.bits });
    layers.push({ id: "sweep-frame", name: "frames", group: "Sweep", kind: "picture", frame: { gray: last.gray, view: [last.place, 0] } });
  }
  return layers;
}

// The layer as a picture, drawn when it is first shown.
function drawn(layer) {
  if (!layer || layer.canvas) return layer?.canvas;
  if (layer.kind === "picture" && !layer.frame.view && scene.color) return (layer.canvas = scene.color);
  const canvas = new OffscreenCanvas(scene.width, scene.height);
  const context = canvas.getContext("2d");
  const image = context.createImageData(scene.width, scene.height);
  const pixels = new Int32Array(image.data.buffer);
  const draw = {
    picture: () => drawGray(layer.frame.gray, pixels),
    disparity: () => drawDisparities(layer.bits, scale.ranges.disparity, palettes.disparity, pixels),
    depth: () => drawDepths(layer.bits, scale.ranges.depth, scene.geometry, palettes.depth, pixels),
    confidence: () => drawConfidences(layer.map.confidences, layer.map.bits, palettes.confidence, pixels),
    error: () => drawErrors(layer.map.bits, scene.truth, palettes.error, pixels),
  };
  draw[layer.kind]();
  context.putImageData(image, 0, 0);
  return (layer.canvas = canvas);
}

function fillChoices() {
  for (const name of ["first", "second"]) {
    const groups = new Map();
    for (const layer of scene.layers) {
      if (!groups.has(layer.group)) groups.set(layer.group, Object.assign(document.createElement("optgroup"), { label: layer.group }));
      groups.get(layer.group).append(new Option(layer.name, layer.id));
    }
    byId(name).replaceChildren(...groups.values());
    if (!layerOf(choice[name])) {
      const pictures = scene.layers.filter((layer) => layer.kind === "picture");
      const others = [...pictures, ...scene.layers];
      choice[name] = (name === "first" ? scene.layers[0] : others[0]).id;
    }
    byId(name).value = choice[name];
  }
}

// The ranges of all maps, but for the few disparities at their ends.
function fullRanges() {
  const all = scene.truth ? [scene.truth] : scene.maps.map((map) => map.bits);
  const sampled = all.map((bits) => bits.filter((value, i) => value !== INVALID && i % 7 === 0));
  const values = new Int16Array(sampled.reduce((count, each) => count + each.length, 0));
  sampled.reduce((start, each) => (values.set(each, start), start + each.length), 0);
  values.sort();
  const ends = (values) => [0.002, 0.998].map((share) => values[Math.round(share * (values.length - 1))] / 64);
  const [least, greatest] = values.length ? ends(values) : [0, 1];
  const disparity = [least - FAR_ROOM * (greatest - least), greatest];
  if (!scene.geometry) return { disparity };
  const finite = values.filter((value) => depth(value / 64, scene.geometry) !== null);
  const [far, near] = finite.length ? ends(finite).map((pixels) => depth(pixels, scene.geometry)) : [1, 0];
  return { disparity, depth: [near, far + FAR_ROOM * (far - near)] };
}

async function open(index) {
  show(await (page.decoded ??= [])[index] ?? await (page.decoded[index] = decode(page.scenes[index])));
}

function show(decoded) {
  scene = decoded;
  byId("viewer").hidden = false;
  panes.resize(scene.width, scene.height);
  byId("cloud").style.aspectRatio = `${scene.width} / ${scene.height}`;
  cloud.points = null;
  scale.reset(fullRanges(), scene.geometry);
  scene.layers.forEach((layer) => {
    layer.canvas = null;
  });
  Object.assign(byId("step"), { max: Math.max(0, scene.sweep.length - 1), value: scene.sweep.length });
  showAround();
  panes.moveCursor([Math.floor(scene.width / 2), Math.floor(scene.height / 2)]);
}

// What stands around the pictures, which depends on the maps.
function showAround() {
  fillChoices();
  const cloudMode = document.querySelector("input[value=cloud]");
  cloudMode.disabled = !scene.geometry || !scene.maps.length;
  cloudMode.parentElement.title = cloudMode.disabled ? "Points need the focal length and the baseline of the rig" : "";
  if (cloudMode.disabled && cloudMode.checked) document.querySelector("input[value=single]").checked = true;
  byId("plots").replaceChildren(...sceneCharts(scene));
  byId("making").replaceChildren(...making());
  byId("left-out").hidden = !scene.left_out.length;
  byId("left-out").textContent = leftOut(scene);
  update();
}

// Shows a scene of a server.
export async function showScene(raw) {
  show(await decode(raw));
}

// Shows another map of the scene in the place of those before. What is looked at stays: the zoom, the cursor, and colours that
// were dragged.
export async function showMap(raw) {
  const target = scene;
  const map = await decodeMap(raw, target.width);
  if (scene !== target) return;
  const hadMap = scene.maps.length > 0;
  const pictures = new Map(scene.layers.filter((layer) => layer.kind === "picture").map((layer) => [layer.id, layer.canvas]));
  scene.maps = [map];
  scene.layers = layersOf(scene);
  scene.layers.forEach((layer) => {
    layer.canvas = pictures.get(layer.id);
  });
  if (!hadMap) choice.first = scene.layers[0].id;
  if (!scale.isDragged) scale.reset(fullRanges(), scene.geometry);
  showAround();
  showPixel();
}

function making() {
  const parts = [];
  const add = (tag, text) => parts.push(Object.assign(document.createElement(tag), { textContent: text }));
  if (page.command) add("pre", page.command);
  add("p", `multiscopic ${page.version}`);
  for (const map of scene.maps) {
    add("h3", map.name);
    const list = document.createElement("dl");
    for (const [name, value] of map.parameters) {
      list.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
    }
    if (map.file) {
      const link = Object.assign(document.createElement("a"), { href: map.file, textContent: map.file });
      const place = document.createElement("dd");
      place.append(link);
      list.append(Object.assign(document.createElement("dt"), { textContent: "file" }), place);
    }
    parts.push(list);
  }
  return parts;
}

// What a page of many scenes does without.
function leftOut({ name, left_out }) {
  const parts = left_out.map((part) => ({ confidences: "confidences", neighbors: "the pictures of the neighbours, and with them costs" })[part]);
  return `Left out here, to keep the page small: ${parts.join("; ")}. A page of ${name} alone has them.`;
}

function measurement(places) {
  if (mode() !== "cloud") return "";
  const text = ([x, y, z]) => `(${x.toFixed(3)}, ${y.toFixed(3)}, ${z.toFixed(3)}) m`;
  if (places.length === 2) {
    const distance = Math.hypot(...places[0].map((value, axis) => value - places[1][axis]));
    return `${(1000 * distance).toFixed(1)} mm between ${text(places[0])} and ${text(places[1])}`;
  }
  return places.length ? `${text(places[0])}: click another point to measure the distance` : "Click two points to measure the distance between them.";
}

function showCloud() {
  const map = currentMap();
  if (cloud.points && cloud.map === map) return cloud.draw();
  const canvas = new OffscreenCanvas(scene.width, scene.height);
  const context = canvas.getContext("2d");
  const center = scene.layers.find((layer) => layer.kind === "picture") ?? scene.layers[0];
  context.drawImage(drawn(center), 0, 0, scene.width, scene.height);
  const colors = new Int32Array(context.getImageData(0, 0, scene.width, scene.height).data.buffer);
  cloud.map = map;
  cloud.show(scene, map.bits, colors);
}

function divide(percent) {
  panes.cut = percent;
  byId("divider").value = percent;
  panes.draw();
}

// Shows another step of the sweep.
function goToStep() {
  const shown = scene.sweep[step()];
  const update = (id, values) => Object.assign(layerOf(id), values, { canvas: null });
  update("sweep-map", { bits: shown.bits });
  update("sweep-frame", { frame: { gray: shown.gray, view: [shown.place, 0] } });
}

function swap() {
  isSwapped = !isSwapped;
  update();
}

function update() {
  const now = mode();
  const isCloud = now === "cloud";
  panes.mode = now;
  byId("second-choice").hidden = now === "single" || isCloud;
  byId("divider-choice").hidden = now !== "divide";
  byId("panes").hidden = isCloud;
  byId("panes").classList.toggle("beside", now === "beside");
  byId("pane-second").hidden = now !== "beside";
  byId("step-choice").hidden = !scene.sweep.length || isCloud;
  if (scene.sweep.length) {
    const { frames, place } = scene.sweep[step()];
    byId("step-text").textContent = `${frames} frames, the last ${Math.abs(place).toFixed(2)} baselines to the ${place < 0 ? "left" : "right"}`;
  }
  byId("cloud").hidden = !isCloud;
  byId("picture-help").hidden = isCloud;
  byId("cloud-help").hidden = !isCloud;
  if (now === "single" || isCloud) isSwapped = false;
  const shown = [layerOf(choice.first), layerOf(choice.second)];
  if (isSwapped) shown.reverse();
  panes.layers = now === "single" || now === "blink" ? [drawn(shown[0])] : shown.map(drawn);
  const label = now === "divide" ? `${shown[0].name} left of the divider, ${shown[1].name} right of it` : shown[0].name;
  byId("pane-first").setAttribute("aria-label", label);
  byId("pane-second").setAttribute("aria-label", shown[1].name);
  const scaled = shown.slice(0, now === "divide" || now === "beside" ? 2 : 1).find((layer) => layer.kind !== "picture");
  scale.of(isCloud ? null : scaled?.kind);
  window.clearInterval(blinkTimer);
  if (now === "blink" && !matchMedia("(prefers-reduced-motion: reduce)").matches) blinkTimer = window.setInterval(swap, BLINK_MS);
  byId("measured").hidden = !isCloud;
  if (isCloud) {
    showCloud();
    byId("measured").textContent = measurement(cloud.picked.map((i) => [...cloud.points.subarray(3 * i, 3 * i + 3)]));
  } else {
    panes.draw();
  }
}

for (const name of ["first", "second"]) {
  byId(name).addEventListener("change", (event) => {
    choice[name] = event.target.value;
    update();
    showPixel();
  });
}
document.querySelectorAll("input[name=mode]").forEach((input) => input.addEventListener("change", update));
byId("divider").addEventListener("input", (event) => divide(Number(event.target.value)));
byId("step").addEventListener("input", () => {
  goToStep();
  update();
  showPixel();
});
const zoom = (factor) => (mode() === "cloud" ? cloud : panes).zoomBy(factor);
byId("zoom-in").addEventListener("click", () => zoom(1.5));
byId("zoom-out").addEventListener("click", () => zoom(1 / 1.5));
byId("fit").addEventListener("click", () => (mode() === "cloud" ? cloud.reset() : panes.fit()));
byId("scene").replaceChildren(...page.scenes.map((each, index) => new Option(each.name, index)));
byId("scene-choice").hidden = page.scenes.length < 2;
byId("scene").addEventListener("change", (event) => open(Number(event.target.value)));
// For whoever wants to look deeper, from the browser's console.
window.multiscopic = { valuesAt: (u, v) => valuesAt(scene, [u, v]), costsAt: (u, v) => costsAt(scene, currentMap().costs, [u, v]), stripe: (u, disparity) => stripe(scene, u, disparity), panes, cloud, current: () => scene };

// Shows the first scene of the page.
export async function openFirst() {
  await open(0);
  document.documentElement.dataset.viewer = "ready";
}
