// The costs of block matching at a pixel, as the matcher defines them: whole numbers, from the same grey values.

// A multiple of 1 to 24, so that all averages are whole numbers, as in the matcher; products stay below 2^53.
const SCALE = 5354228880;

const clamp = (value, last) => (value < 0 ? 0 : value > last ? last : value);

function sumOfDifferences({ width, height }, center, view, [u, v], [matchU, matchV], radius) {
  let sum = 0;
  for (let y = -radius; y <= radius; y++) {
    const row = clamp(v + y, height - 1) * width;
    const matchRow = clamp(matchV + y, height - 1) * width;
    for (let x = -radius; x <= radius; x++) {
      sum += Math.abs(center[row + clamp(u + x, width - 1)] - view[matchRow + clamp(matchU + x, width - 1)]);
    }
  }
  return sum;
}

// How many of the sorted costs a rule averages.
const RULES = {
  min: () => 1,
  mean: (costs) => costs.length,
  half: (costs) => Math.ceil(costs.length / 2),
  heuristic: (costs) => (costs.length < 3 ? costs.length : costs[2].cost > 3 * costs[1].cost ? 2 : 3),
};

// The costs of each view over the disparities, the fused ones, and the choice.
// A block sample beyond the centre image is moved first; each image then clamps its own coordinates.
export function costsAt(scene, { block_size, min_disparity, num_disparities, fusion, views }, [u, v]) {
  const radius = (block_size - 1) / 2;
  const { width, height } = scene;
  const center = scene.frames[0].gray;
  const neighbors = views.map(([right, down]) => scene.frames.find((frame) => frame.view && frame.view[0] === right && frame.view[1] === down));
  const candidates = [];
  for (let d = min_disparity; d < min_disparity + num_disparities; d++) {
    const costs = [];
    neighbors.forEach((frame, index) => {
      const match = [u - frame.view[0] * d, v - frame.view[1] * d];
      if (match[0] < 0 || match[0] >= width || match[1] < 0 || match[1] >= height) return;
      costs.push({ index, cost: sumOfDifferences(scene, center, frame.gray, [u, v], match, radius) });
    });
    costs.sort((a, b) => a.cost - b.cost);
    const count = costs.length && RULES[fusion](costs);
    const sum = costs.slice(0, count).reduce((total, { cost }) => total + cost, 0);
    candidates.push({ d, costs, count, fused: count ? sum * (SCALE / count) : null });
  }
  return { candidates, samples: block_size ** 2, choice: choose(candidates), names: neighbors.map((frame) => frame.name) };
}

function choose(candidates) {
  let best = null;
  candidates.forEach((candidate, i) => {
    if (candidate.fused !== null && (best === null || candidate.fused < candidates[best].fused)) best = i;
  });
  if (best === null) return null;
  const [before, at, after] = [candidates[best - 1], candidates[best], candidates[best + 1]];
  let bits = at.d * 64;
  if (before && after && before.fused !== null && after.fused !== null) {
    const [a, c, b] = [before.fused, at.fused, after.fused];
    const curvature = 2 * a + 2 * b - 4 * c;
    const shift = curvature === 0 ? 0 : (64 * (a - b)) / curvature;
    const exact = bits + shift;
    bits = Math.sign(exact) * Math.floor(Math.abs(exact) + 0.5);
  }
  return { ...at, bits };
}

// The mean cost of a sample, as it is drawn.
export const perSample = (fused, samples) => fused / SCALE / samples;

// Which views were fused at the chosen disparity, and why.
export function explanation({ choice, names }, fusion) {
  if (!choice) return "No view sees this pixel at any of the disparities.";
  const { costs, count, d } = choice;
  const used = costs.slice(0, count).map(({ index }) => names[index]);
  const ratio = () => (costs[1].cost === 0 ? "infinitely" : `${(costs[2].cost / costs[1].cost).toFixed(1)} times`);
  const why = {
    min: () => "the least cost",
    mean: () => "the mean of all",
    half: () => `the mean of the lower half of ${costs.length}`,
    heuristic: () =>
      costs.length < 3 ? "the mean of all that see it" : `the third-least cost is ${ratio()} the second, ${count === 2 ? "more than 3 times: it is left out" : "no more than 3 times: it is kept"}`,
  }[fusion]();
  const unseen = names.filter((_, index) => !costs.some((cost) => cost.index === index));
  const missing = unseen.length ? ` Outside the image there: ${unseen.join(", ")}.` : "";
  return `At ${d} px, ${fusion} takes ${used.join(", ")}: ${why}.${missing}`;
}
