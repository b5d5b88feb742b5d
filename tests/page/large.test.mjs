// Opens the page of a large rig, and measures how smooth it is. To render and match one takes long without optimization: the
// test puts numbers in its place that take as long to decode. Arguments: the browser, and a page.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { pathToFileURL } from "node:url";
import { deflateSync } from "node:zlib";
import { Browser, settled } from "./browser.mjs";

const [browserPath, pagePath] = process.argv.slice(2);
const browser = await Browser.launch(browserPath);
const SIZE = [1390, 1110];
const OPENING_SECONDS = 3;
const FRAME_MS = 50;

// The milliseconds of work for a frame of the screen while something is done on the page.
async function frameWork({ page, work }, act) {
  await page.evaluate(() => {
    window.frames = 0;
    const tick = () => {
      if (window.frames === null) return;
      window.frames++;
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  });
  const before = await work();
  await act();
  const after = await work();
  const frames = await page.evaluate(() => {
    const { frames } = window;
    window.frames = null;
    return frames;
  });
  assert(frames >= 5, `${frames} frames`);
  return (1000 * (after - before)) / frames;
}

async function assertOpensSoon({ work }) {
  const seconds = await work();
  assert(seconds < OPENING_SECONDS, `to open it takes ${seconds.toFixed(1)} s of work`);
  return seconds;
}

async function assertSmooth(opened) {
  const { page } = opened;
  const box = await (await page.$("#pane-first")).boundingBox();
  const move = (x, y) => page.mouse.move(box.x + x * box.width, box.y + y * box.height);
  const sweep = async ([fromX, fromY], [toX, toY]) => {
    for (let k = 0; k <= 20; k++) await move(fromX + ((toX - fromX) * k) / 20, fromY + ((toY - fromY) * k) / 20);
  };
  const choose = (mode) => page.$eval(`input[name=mode][value=${mode}]`, (input) => input.click());
  const actions = {
    hover: () => sweep([0.1, 0.2], [0.9, 0.7]),
    divide: async () => {
      await page.mouse.down();
      await sweep([0.5, 0.3], [0.9, 0.3]);
      await page.mouse.up();
    },
    zoom: async () => {
      for (let k = 0; k < 20; k++) await page.mouse.wheel({ deltaY: k < 10 ? -100 : 60 });
    },
  };
  const times = {};
  for (const [name, act] of Object.entries(actions)) {
    await choose(name === "divide" ? "divide" : "single");
    await move(0.5, 0.3);
    await settled(page);
    times[name] = Math.round(await frameWork(opened, act));
  }
  assert(Object.values(times).every((time) => time < FRAME_MS), `milliseconds of work for a frame: ${JSON.stringify(times)}`);
  return times;
}

// A plane as the program writes it, whose values differ by up to `most` from what their neighbours predict: of `bytes` bytes
// each, the low ones first.
function plane(most, bytes) {
  const count = SIZE[0] * SIZE[1];
  const values = Buffer.alloc(bytes * count);
  let state = 1;
  for (let i = 0; i < count; i++) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    const difference = i === 0 ? 20 * 64 : ((state >>> 16) % (2 * most + 1)) - most;
    for (let k = 0; k < bytes; k++) values[k * count + i] = difference >> (8 * k);
  }
  return deflateSync(values).toString("base64");
}

// The scene of a page with other pictures and maps.
function enlarged(scene) {
  const [gray, disparities, confidences] = [plane(12, 1), plane(1, 2), plane(2, 1)];
  const frames = scene.frames.map((frame) => ({ ...frame, gray }));
  const maps = scene.maps.map((map) => ({ ...map, disparities, confidences }));
  return { ...scene, size: SIZE, frames, maps, color: null, truth: disparities };
}

const html = readFileSync(pagePath, "utf8");
const [, json] = html.match(/id="viewer-data">(.*?)<\/script>/s);
const data = JSON.parse(json);
data.scenes = data.scenes.map(enlarged);
// Beside the page, whose other pictures it shows.
const path = join(dirname(pagePath), "large.html");
writeFileSync(path, html.replace(json, () => JSON.stringify(data).replaceAll("<", "\\u003c")));

const address = pathToFileURL(path).href;
const opened = await browser.open(address, [1920, 1200], "light", [new URL(".", address).href]);
await browser.check("a large rig opens soon, and stays smooth", async () => {
  const shown = await opened.page.evaluate(() => {
    const { width, height, frames } = multiscopic.current();
    return [width, height, frames.length];
  });
  assert.deepEqual(shown, [...SIZE, 5]);
  console.log("seconds to open it:", await assertOpensSoon(opened), "milliseconds for a frame:", await assertSmooth(opened));
});
await browser.close();
console.log("a large rig: every check passed");
