// Charts: the costs at a pixel, the errors of maps, and the wrong pixels among the surest.

import { perSample } from "viewer/costs.js";
import { INVALID } from "viewer/numbers.js";

const SVG = "http://www.w3.org/2000/svg";

function element(name, attributes, text) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

// A chart of lines of [x, y] points. `markers` are vertical lines with a label.
export function lineChart({ label, x, y, lines, markers = [] }) {
  const [width, height, left, right, top, bottom] = [460, 230, 46, 10, 14, 40];
  const all = lines.flatMap((line) => line.points);
  const [from, to] = [Math.min(...all.map((p) => p[0])), Math.max(...all.map((p) => p[0]))];
  const most = Math.max(...all.map((p) => p[1]), 1e-9);
  const px = (value) => left + ((width - left - right) * (value - from)) / Math.max(to - from, 1e-9);
  const py = (value) => height - bottom - ((height - top - bottom) * value) / most;
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label, class: "plot" });
  for (const share of [0, 0.5, 1]) {
    svg.append(element("line", { x1: left, x2: width - right, y1: py(share * most), y2: py(share * most), class: "grid" }));
    svg.append(element("text", { x: left - 6, y: py(share * most) + 4, "text-anchor": "end" }, (share * most).toPrecision(2)));
    const value = from + share * (to - from);
    svg.append(element("text", { x: px(value), y: height - bottom + 15, "text-anchor": ["start", "middle", "end"][2 * share] }, Number(value.toFixed(1))));
  }
  svg.append(element("text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, x));
  svg.append(element("text", { x: -(height - bottom + top) / 2, y: 11, transform: "rotate(-90)", "text-anchor": "middle" }, y));
  for (const { at, style } of markers) svg.append(element("line", { x1: px(at), x2: px(at), y1: top, y2: height - bottom, class: style }));
  lines.forEach(({ points, style }) => {
    const path = points.map(([a, b], i) => `${i ? "L" : "M"}${px(a).toFixed(1)} ${py(b).toFixed(1)}`).join("");
    svg.append(element("path", { d: path, class: style }));
  });
  return svg;
}

function legend(items) {
  const list = document.createElement("ul");
  list.className = "legend";
  for (const [style, name] of items) {
    const item = document.createElement("li");
    const swatch = element("svg", { viewBox: "0 0 24 8", width: 24, height: 8, "aria-hidden": "true" });
    swatch.append(element("path", { d: "M0 4H24", class: style }));
    item.append(swatch, name);
    list.append(item);
  }
  return list;
}

// The costs of each view over the disparities, the fused ones, and where the map has its disparity.
export function costChart({ candidates, samples, names }, mapPixels) {
  const series = names.map((name, index) => ({
    style: `line line-${index % 8}`,
    name,
    points: candidates.flatMap(({ d, costs }) => costs.filter((cost) => cost.index === index).map(({ cost }) => [d, cost / samples])),
  }));
  const fused = candidates.filter((candidate) => candidate.fused !== null).map(({ d, fused }) => [d, perSample(fused, samples)]);
  const lines = [...series, { style: "line fused", name: "fused", points: fused }].filter((line) => line.points.length);
  if (!lines.length) return [];
  const markers = mapPixels === null ? [] : [{ at: mapPixels, style: "chosen" }];
  const chart = lineChart({ label: "Costs over the disparities", x: "disparity in pixels", y: "grey levels per sample", lines, markers });
  return [chart, legend([...lines.map(({ style, name }) => [style, name]), ...(markers.length ? [["chosen", "the map"]] : [])])];
}

// The share of pixels more than one pixel off among the surest, at densities of 5 to 100 %.
export function sparsification(bits, confidences, truth) {
  const counts = Array.from({ length: 256 }, () => [0, 0]);
  for (let i = 0; i < bits.length; i++) {
    if (truth[i] === INVALID) continue;
    const isWrong = bits[i] === INVALID || Math.abs(bits[i] - truth[i]) > 64;
    counts[bits[i] === INVALID ? 0 : confidences[i]][Number(isWrong)]++;
  }
  const total = counts.reduce((sum, [right, wrong]) => sum + right + wrong, 0);
  const wrongAt = (density) => {
    let [rest, wrong] = [density * total, 0];
    for (let confidence = 255; confidence >= 0 && rest > 0; confidence--) {
      const [rightHere, wrongHere] = counts[confidence];
      if (rightHere + wrongHere === 0) continue;
      const share = Math.min(1, rest / (rightHere + wrongHere));
      wrong += share * wrongHere;
      rest -= share * (rightHere + wrongHere);
    }
    return wrong / (density * total);
  };
  return Array.from({ length: 20 }, (_, k) => [5 * (k + 1), 100 * wrongAt((k + 1) / 20)]);
}

// All charts of a scene whose truth is known.
export function sceneCharts({ maps, truth }) {
  const charts = [];
  const measured = maps.filter((map) => map.metrics);
  if (measured.length) {
    charts.push(bars("AvgErr in pixels", measured, (m) => m.avg_err, (m) => m.reduction?.avg_err, (v) => v.toFixed(3)));
    charts.push(bars("RMS in pixels", measured, (m) => m.rms, (m) => m.reduction?.rms, (v) => v.toFixed(3)));
    charts.push(bars("Pixels off by more than 1 pixel", measured, (m) => m.bad_1, () => null, (v) => `${v.toFixed(1)} %`));
    // Filters leave pixels out, which count as wrong above.
    if (measured.some((map) => map.metrics.left)) {
      const left = (m) => m.left ?? m;
      charts.push(bars("AvgErr of the pixels that are left", measured, (m) => left(m).avg_err, () => null, (v) => v.toFixed(3)));
      charts.push(bars("Off by more than 1 pixel, of those left", measured, (m) => left(m).bad_1, () => null, (v) => `${v.toFixed(1)} %`));
    }
  }
  const sure = truth ? maps.filter((map) => map.confidences) : [];
  if (sure.length) {
    const lines = sure.map((map, index) => ({
      style: `line line-${index % 8}`,
      name: map.name,
      points: sparsification(map.bits, map.confidences, truth),
    }));
    const figure = document.createElement("figure");
    figure.className = "curve";
    const caption = document.createElement("figcaption");
    caption.textContent = "Wrong pixels among the surest: the lower, the better the confidences";
    const chart = lineChart({ label: caption.textContent, x: "surest pixels in percent", y: "wrong in percent", lines });
    figure.append(caption, chart, legend(lines.map(({ style, name }) => [style, name])));
    charts.push(figure);
  }
  return charts;
}

function bars(title, maps, value, reduction, text) {
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  caption.textContent = title;
  const list = document.createElement("ul");
  list.className = "bars";
  const most = Math.max(...maps.map((map) => value(map.metrics)), 1e-9);
  for (const map of maps) {
    const item = document.createElement("li");
    const [name, bar, number] = ["span", "span", "span"].map((tag) => document.createElement(tag));
    const lower = reduction(map.metrics);
    name.textContent = map.name;
    bar.className = "amount";
    bar.style.width = `${(100 * value(map.metrics)) / most}%`;
    number.textContent = text(value(map.metrics)) + (lower === null || lower === undefined ? "" : ` (${lower > 0 ? "−" : "+"}${Math.abs(100 * lower).toFixed(0)} %)`);
    const track = document.createElement("span");
    track.className = "track";
    track.append(bar);
    item.append(name, track, number);
    list.append(item);
  }
  figure.append(caption, list);
  return figure;
}
