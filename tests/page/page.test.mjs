// Drives the page in a headless browser. Arguments: the browser, the page, the folder with the maps, and a folder for
// screenshots.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { pathToFileURL } from "node:url";
import { Browser, assertUsable, changed, pixels, readPfm, settled } from "./browser.mjs";

const [browserPath, pagePath, folder, screenshots] = process.argv.slice(2);
const address = pathToFileURL(pagePath).href;
const browser = await Browser.launch(browserPath);
const check = (name, run) => browser.check(name, run);
const opened = (width, height, scheme) => browser.open(address, [width, height], scheme, [new URL(".", address).href]);

const choose = (page, mode) => page.$eval(`input[name=mode][value=${mode}]`, (input) => input.click());

const { page, work } = await opened(1280, 1000, "light");
const seconds = await work();
await page.screenshot({ path: join(screenshots, "wide-light.png"), fullPage: true });

await check(`the page opens with ${seconds.toFixed(1)} s of work`, () => assert(seconds < 10));

await check("the values under the cursor are those in the files", async () => {
  const names = await page.evaluate(() => multiscopic.current().maps.map(({ name, file }) => [name, file]));
  assert(names.length >= 3, "several methods");
  const geometry = await page.evaluate(() => multiscopic.current().geometry);
  for (const [index, [name, file]] of names.entries()) {
    const map = readPfm(join(folder, file));
    const truth = readPfm(join(folder, "truth.pfm"));
    for (let k = 0; k < 400; k++) {
      const [u, v] = [(k * 37) % map.width, (k * 53) % map.height];
      const { maps, truth: known } = await page.evaluate((u, v) => multiscopic.valuesAt(u, v), u, v);
      const expected = map.at(u, v);
      assert.equal(maps[index].disparity, Number.isFinite(expected) ? expected : null, `${name} at ${u}, ${v}`);
      assert(Math.abs(known - truth.at(u, v)) <= 1 / 128, `the truth at ${u}, ${v}`);
      if (Number.isFinite(expected)) {
        const metres = (geometry.focal_px * geometry.baseline_mm) / (expected + geometry.doffs) / 1000;
        assert(Math.abs(maps[index].depth - metres) < 1e-6 * metres, "the depth");
      }
    }
  }
});

await check("the read-out shows them", async () => {
  const box = await (await page.$("#pane-first")).boundingBox();
  await page.mouse.move(box.x + 0.3 * box.width, box.y + 0.6 * box.height);
  await settled(page);
  const place = await page.$eval("#place", (node) => node.textContent);
  const [u, v] = place.match(/\d+/g).map(Number);
  const { maps } = await page.evaluate((u, v) => multiscopic.valuesAt(u, v), u, v);
  const row = await page.$$eval("#values tr:nth-child(2) td", (cells) => cells.map((cell) => cell.textContent));
  assert.equal(row[0], maps[0].name);
  assert.equal(row[1], maps[0].disparity === null ? "–" : maps[0].disparity.toFixed(2));
  assert.equal(row[2], maps[0].depth === null ? "–" : maps[0].depth.toFixed(3));
});

await check("the costs lead to the disparities of block matching, bit for bit", async () => {
  const value = await page.$$eval("#first option", (options) => options.find((option) => /^bm [2-9]/.test(option.textContent)).value);
  await page.select("#first", value);
  const wrong = await page.evaluate(() => {
    const scene = multiscopic.current();
    const map = scene.maps.find((each) => each.costs.exact && each.costs.views.length === 4);
    const option = [...document.querySelectorAll("#first option")].find((each) => each.textContent === map.name);
    document.querySelector("#first").value = option.value;
    document.querySelector("#first").dispatchEvent(new Event("change"));
    const wrong = [];
    for (let k = 0; k < 1500; k++) {
      const [u, v] = [k < 200 ? k % 12 : (k * 131) % scene.width, (k * 17) % scene.height];
      const { choice } = multiscopic.costsAt(u, v);
      const bits = map.bits[v * scene.width + u];
      if ((choice ? choice.bits : -32768) !== bits) wrong.push([u, v, choice?.bits, bits]);
    }
    return wrong;
  });
  assert.deepEqual(wrong, []);
  const text = await page.$eval("#fused", (node) => node.textContent);
  assert.match(text, /px, heuristic takes/);
  assert(await page.$("#costs svg path"), "a chart");
});

await check("the divider is dragged", async () => {
  await choose(page, "divide");
  await page.mouse.move(5, 5);
  const width = await page.$eval("#pane-first", (canvas) => canvas.width);
  const before = await pixels(page, "#pane-first");
  const box = await (await page.$("#pane-first")).boundingBox();
  await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.3 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.8 * box.width, box.y + 0.3 * box.height, { steps: 5 });
  await page.mouse.up();
  const after = await pixels(page, "#pane-first");
  const at = await page.$eval("#divider", (input) => Number(input.value));
  assert(Math.abs(at - 80) <= 1, `the divider is at ${at}`);
  assert(changed(before, after, [0.53, 0.77], width) > 0.8, "what the divider passed over shows the other picture");
  assert(changed(before, after, [0.85, 1], width) < 0.05, "what is right of it is the same");
  await page.screenshot({ path: join(screenshots, "divide.png") });
});

await check("zoom and move are linked, and the keyboard does as the mouse", async () => {
  await choose(page, "beside");
  await settled(page);
  const [first, second] = [await pixels(page, "#pane-first"), await pixels(page, "#pane-second")];
  const box = await (await page.$("#pane-first")).boundingBox();
  await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.5 * box.height);
  await page.mouse.wheel({ deltaY: -400 });
  assert(changed(first, await pixels(page, "#pane-first")) > 0.3);
  assert(changed(second, await pixels(page, "#pane-second")) > 0.3);
  await page.screenshot({ path: join(screenshots, "beside.png") });
  await page.focus("#pane-first");
  await page.keyboard.press("0");
  const before = await page.evaluate(() => multiscopic.panes.cursor);
  await page.keyboard.press("ArrowRight");
  await page.keyboard.down("Shift");
  await page.keyboard.press("ArrowDown");
  await page.keyboard.up("Shift");
  const after = await page.evaluate(() => multiscopic.panes.cursor);
  assert.deepEqual([after[0] - before[0], after[1] - before[1]], [1, 10]);
  const spoken = await page.$eval("#spoken", (node) => node.textContent);
  assert.match(spoken, new RegExp(`Column ${after[0]}, row ${after[1]}: .*(pixels|no disparity)`));
});

await check("the range of colours is dragged", async () => {
  await choose(page, "single");
  const before = await pixels(page, "#pane-first");
  await page.focus("#upper");
  for (let k = 0; k < 60; k++) await page.keyboard.press("ArrowLeft");
  assert(changed(before, await pixels(page, "#pane-first")) > 0.3);
});

await check("depths have colours, and a scale in metres", async () => {
  await page.select("#first", "depth-0");
  const { colors, depths, near, far } = await page.evaluate(() => {
    const scene = multiscopic.current();
    const { canvas } = scene.layers.find(({ id }) => id === "depth-0");
    const pixels = canvas.getContext("2d").getImageData(0, 0, scene.width, scene.height).data;
    const [near, far] = ["lower", "upper"].map((id) => Number(document.getElementById(id).value));
    const samples = Array.from({ length: 500 }, (_, k) => [(k * 37) % scene.width, (k * 53) % scene.height]);
    return {
      colors: samples.map(([u, v]) => [...pixels.slice(4 * (v * scene.width + u), 4 * (v * scene.width + u) + 3)]),
      depths: samples.map(([u, v]) => multiscopic.valuesAt(u, v).maps[0].depth),
      near,
      far,
    };
  });
  assert(near > 0.2 && far < 5, `${near} to ${far} m`);
  assert.match(await page.$eval("#scale-title", (node) => node.textContent), /^Depth: [\d.]+ m to [\d.]+ m/);
  const isRed = ([r, , b]) => r > 2 * b;
  const third = (far - near) / 3;
  for (const [i, depth] of depths.entries()) {
    if (depth === null) assert.deepEqual(colors[i], [0, 0, 0]);
    else if (depth < near + third) assert(isRed(colors[i]), `${depth} m is ${colors[i]}`);
    else if (depth > far - third) assert(!isRed(colors[i]), `${depth} m is ${colors[i]}`);
  }
  const before = await pixels(page, "#pane-first");
  await page.focus("#upper");
  for (let k = 0; k < 60; k++) await page.keyboard.press("ArrowLeft");
  assert(changed(before, await pixels(page, "#pane-first")) > 0.3);
  await page.select("#first", "disparity-0");
});

await check("blinking shows two pictures in turn", async () => {
  await choose(page, "blink");
  const different = await page.evaluate(async () => {
    const canvas = document.querySelector("#pane-first");
    const seen = new Map();
    while (seen.size < 2) {
      await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)));
      const copy = new OffscreenCanvas(100, 75).getContext("2d", { willReadFrequently: true });
      copy.drawImage(canvas, 0, 0, 100, 75);
      seen.set(canvas.getAttribute("aria-label"), copy.getImageData(0, 0, 100, 75).data);
    }
    const [one, other] = [...seen.values()];
    return one.filter((value, i) => Math.abs(value - other[i]) > 20).length / one.length;
  });
  assert(different > 0.3, `${different} of the picture differs`);
});

await check("the point cloud is turned, and measured in millimetres", async () => {
  await choose(page, "cloud");
  const before = await pixels(page, "#cloud");
  const seen = before.filter((value, i) => i % 4 === 3 && value > 0).length / (before.length / 4);
  assert(seen > 0.2, `the cloud covers ${seen} of its canvas`);
  await page.screenshot({ path: join(screenshots, "cloud.png") });
  const box = await (await page.$("#cloud")).boundingBox();
  await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.5 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.6 * box.width, box.y + 0.55 * box.height, { steps: 5 });
  await page.mouse.up();
  assert(changed(before, await pixels(page, "#cloud")) > 0.2, "it turns");
  await page.mouse.click(box.x + 0.45 * box.width, box.y + 0.5 * box.height);
  await page.mouse.click(box.x + 0.6 * box.width, box.y + 0.6 * box.height);
  const measured = await page.$eval("#measured", (node) => node.textContent);
  const millimetres = Number(measured.match(/^([\d.]+) mm between/)?.[1]);
  const expected = await page.evaluate(() => {
    const { picked, points } = multiscopic.cloud;
    const [a, b] = picked.map((i) => points.subarray(3 * i, 3 * i + 3));
    return 1000 * Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  });
  assert(millimetres > 1 && Math.abs(millimetres - expected) < 0.1, `${measured} ${expected}`);
});
await page.close();

for (const [width, scheme] of [[1600, "dark"], [390, "light"], [390, "dark"], [900, "dark"]]) {
  await check(`no violation of accessibility at ${width} pixels, ${scheme}`, async () => {
    const { page } = await opened(width, 844, scheme);
    for (const mode of ["single", "divide", "beside", "cloud"]) {
      await choose(page, mode);
      await assertUsable(page, mode);
    }
    await choose(page, "divide");
    await settled(page);
    await page.screenshot({ path: join(screenshots, `${width}-${scheme}.png`), fullPage: true });
    await page.close();
  });
}
await check("a page says what is left out", async () => {
  const html = readFileSync(pagePath, "utf8");
  const [, json] = html.match(/id="viewer-data">(.*?)<\/script>/s);
  const data = JSON.parse(json);
  const [scene] = data.scenes;
  scene.frames = scene.frames.slice(0, 1);
  for (const map of scene.maps) Object.assign(map, { costs: null, confidences: null });
  scene.left_out = ["confidences", "neighbors"];
  const path = join(dirname(pagePath), "left-out.html");
  writeFileSync(path, html.replace(json, () => JSON.stringify(data).replaceAll("<", "\\u003c")));
  const { page } = await browser.open(pathToFileURL(path).href, [1280, 1000], "light", [new URL(".", address).href]);
  assert.match(await page.$eval("#left-out", (node) => node.textContent), /confidences; the pictures of the neighbours/);
  assert.match(await page.$eval("#fused", (node) => node.textContent), /^No costs: .* left out/);
  await page.close();
});
await browser.close();
console.log("the page: every check passed");
