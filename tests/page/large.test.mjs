// Opens the page of a large rig, and its live view, and measures how smooth they are. Arguments: the browser, the program, the rig, its
// page, and a folder for screenshots.

import assert from "node:assert/strict";
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import { Browser, Server, settled } from "./browser.mjs";

const [browserPath, program, rig, pagePath, screenshots] = process.argv.slice(2);
const browser = await Browser.launch(browserPath);
const OPENING_SECONDS = 3;
const FRAME_MS = 50;

// The median time between frames of the screen while something is done on the page, in milliseconds.
async function frameTime(page, act) {
  await page.evaluate(() => {
    const [times, start] = [[], performance.now()];
    let last = start;
    const tick = (now) => {
      times.push(now - last);
      last = now;
      if (window.frameTimes === times) requestAnimationFrame(tick);
    };
    window.frameTimes = times;
    requestAnimationFrame(tick);
  });
  await act();
  const times = await page.evaluate(() => {
    const times = window.frameTimes.slice(2);
    window.frameTimes = null;
    return times;
  });
  assert(times.length >= 5, `${times.length} frames`);
  return times.sort((a, b) => a - b)[Math.floor(times.length / 2)];
}

// Others may keep the machine busy: the best of three.
async function opened(open) {
  let best = null;
  for (let k = 0; k < 3; k++) {
    const now = await open();
    if (!best || now.seconds < best.seconds) {
      await best?.page.close();
      best = now;
    } else {
      await now.page.close();
    }
    if (best.seconds < OPENING_SECONDS) break;
  }
  // A page behind another one draws no frames.
  await best.page.bringToFront();
  assert(best.seconds < OPENING_SECONDS, `it opens in ${best.seconds.toFixed(1)} s`);
  return best;
}

async function assertSmooth(page) {
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
    times[name] = Math.round(await frameTime(page, act));
  }
  assert(Object.values(times).every((time) => time < FRAME_MS), `milliseconds for a frame: ${JSON.stringify(times)}`);
  return times;
}

const folder = new URL(".", pathToFileURL(pagePath)).href;
const large = await opened(() => browser.open(pathToFileURL(pagePath).href, [1920, 1200], "light", [folder]));
await browser.check(`a large rig opens in ${large.seconds.toFixed(1)} s, and stays smooth`, async () => {
  const { width, height, frames } = await large.page.evaluate(() => multiscopic.current());
  assert.deepEqual([width, height, frames.length], [1390, 1110, 5]);
  console.log("milliseconds for a frame:", await assertSmooth(large.page));
  await large.page.screenshot({ path: join(screenshots, "large.png"), fullPage: true });
  await large.page.close();
});

const server = await Server.start(program, ["tune", rig]);
const tuned = await opened(() => server.open(browser, [1920, 1200], "dark"));
await browser.check(`its live view opens in ${tuned.seconds.toFixed(1)} s, and stays smooth`, async () => {
  console.log("milliseconds for a frame:", await assertSmooth(tuned.page));
  await tuned.page.close();
});
await server.end();
await browser.close();
console.log("a large rig: every check passed");
