// Drives the page of a sweep in a headless browser. Arguments: the browser, the page, the folder of the rig, and a folder for
// screenshots.

import assert from "node:assert/strict";
import { dirname, join } from "node:path";
import { pathToFileURL } from "node:url";
import { Browser, assertUsable, changed, pixels, readPfm, settled } from "./browser.mjs";

const [browserPath, pagePath, folder, screenshots] = process.argv.slice(2);
const browser = await Browser.launch(browserPath);
const check = (name, run) => browser.check(name, run);
const address = pathToFileURL(pagePath).href;
const { page } = await browser.open(address, [1280, 1000], "light", [pathToFileURL(dirname(pagePath)).href]);
const truth = readPfm(join(folder, "truth.pfm"));
const goTo = async (step) => {
  await page.$eval("#step", (input, step) => {
    input.value = step;
    input.dispatchEvent(new Event("input"));
  }, step);
  await settled(page);
};

await check("frames show the same grey along the stripes of the true disparities", async () => {
  const samples = [];
  for (let v = 10; v < truth.height - 10; v += 4) for (let u = 40; u < truth.width - 40; u += 5) samples.push([u, v, truth.at(u, v)]);
  const differences = await page.evaluate((samples) => {
    const { frames, sweep, width } = multiscopic.current();
    const lines = [{ place: 0, gray: frames[0].gray }, ...sweep].sort((a, b) => a.place - b.place);
    const grayAt = (gray, x, v) => {
      const left = Math.floor(x);
      return gray[v * width + left] * (left + 1 - x) + gray[v * width + left + 1] * (x - left);
    };
    return samples.flatMap(([u, v, d]) => multiscopic.stripe(u, d).map((x, line) => Math.abs(grayAt(lines[line].gray, x, v) - frames[0].gray[v * width + u])));
  }, samples);
  assert(differences.length > 10 * samples.length, "many frames");
  differences.sort((a, b) => a - b);
  const median = differences[differences.length >> 1];
  assert(median < 6, `grey values differ by ${median}`);
});

await check("the map sharpens frame by frame", async () => {
  const maps = await page.evaluate(() => multiscopic.current().sweep.map(({ bits }) => [...bits]));
  const wrong = maps.map((bits) => {
    const isWrong = (value, i) => value === -32768 || Math.abs(value / 64 - truth.at(i % truth.width, Math.floor(i / truth.width))) > 1;
    return bits.filter(isWrong).length / bits.length;
  });
  assert(maps.length >= 8 && wrong.at(-1) < 0.8 * wrong[0], `${wrong}`);
});

await check("the slider goes through the frames", async () => {
  for (const layer of ["sweep-map", "sweep-frame"]) {
    await page.select("#first", layer);
    await goTo(0);
    const before = await pixels(page, "#pane-first");
    const text = await page.$eval("#step-text", (node) => node.textContent);
    assert.match(text, /^\d+ frames, the last 0\.\d\d baselines to the (left|right)$/);
    await page.screenshot({ path: join(screenshots, `${layer}-first.png`), fullPage: true });
    await goTo(99);
    assert(changed(before, await pixels(page, "#pane-first")) > 0.02, layer);
    assert.notEqual(await page.$eval("#step-text", (node) => node.textContent), text);
    await page.screenshot({ path: join(screenshots, `${layer}-last.png`), fullPage: true });
  }
});

await check("the slice follows the cursor", async () => {
  const slice = () => page.$eval("#slice", (canvas) => [canvas.getAttribute("aria-label"), canvas.toDataURL()]);
  await page.focus("#pane-first");
  const before = await slice();
  for (let k = 0; k < 8; k++) await page.keyboard.press("ArrowDown");
  const after = await slice();
  const row = await page.evaluate(() => multiscopic.panes.cursor[1]);
  assert(after[0].startsWith(`Epipolar slice of row ${row}: `), after[0]);
  assert.notEqual(before[1], after[1]);
});

await check("no violation of accessibility", () => assertUsable(page, "sweep"));
await browser.close();
console.log("the page of a sweep: every check passed");
