// Drives the live view in a headless browser. Arguments: the browser, the program, a rig, an empty folder, and a folder for
// screenshots.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readdirSync } from "node:fs";
import { join } from "node:path";
import { Browser, Server, assertUsable, readPfm } from "./browser.mjs";

const [browserPath, program, rig, folder, screenshots] = process.argv.slice(2);
const browser = await Browser.launch(browserPath);
const check = (name, run) => browser.check(name, run);

// Does something on the page, and waits for the disparities that come of it.
async function matched(page, act) {
  await page.evaluate(() => {
    window.matchedSettings = new Promise((done) => window.addEventListener("matched", (event) => done(event.detail), { once: true }));
  });
  await act();
  return page.evaluate(() => window.matchedSettings);
}

// Waits for the disparities of a new rig by the method of match, which follow those of block matching.
const showsNet = (page) => page.waitForFunction(() => /^net, /.test(document.getElementById("state").textContent));

// Sets controls by their options, as a user does: their values change, and they say so.
const set = (page, settings) =>
  page.evaluate((settings) => {
    for (const [option, value] of Object.entries(settings)) {
      const input = document.getElementById(`option-${option}`);
      if (input.type === "checkbox") input.checked = value;
      else input.value = value;
      input.dispatchEvent(new Event(input.type === "range" ? "input" : "change"));
    }
  }, settings);

// The words of a command line as a shell reads them.
const words = (command) => [...command.matchAll(/'([^']*)'|(\S+)/g)].map(([, quoted, plain]) => quoted ?? plain);

// Compares what the page shows with what its own command writes.
async function assertIsMatch(page, name) {
  const command = await page.$eval("#command", (node) => node.textContent);
  const [first, ...rest] = words(command);
  assert.equal(first, "multiscopic");
  const output = join(folder, "disparity.pfm");
  execFileSync(program, rest.map((word) => (word === "disparity.pfm" ? output : word)), { stdio: ["ignore", "inherit", "ignore"] });
  const file = readPfm(output);
  const { bits, width } = await page.evaluate(() => ({ bits: [...multiscopic.current().maps[0].bits], width: multiscopic.current().width }));
  assert.equal(bits.length, file.width * file.height);
  let valid = 0;
  bits.forEach((value, i) => {
    const expected = file.at(i % width, Math.floor(i / width));
    const found = value === -32768 ? Infinity : value / 64;
    assert.equal(found, expected, `${name}: ${command} at ${i % width}, ${Math.floor(i / width)}`);
    if (value !== -32768) valid++;
  });
  assert(valid > 0, `${name}: some pixels have a disparity`);
}

const tune = await Server.start(program, ["tune", rig]);
const { page } = await tune.open(browser, [1400, 1000], "light");

await check("the page of a rig opens with its disparities, by the method of match", async () => {
  await showsNet(page);
  await assertIsMatch(page, "at first");
  await page.screenshot({ path: join(screenshots, "tune-wide-light.png"), fullPage: true });
});

await check("a slider changes the disparities to those of match, bit for bit", async () => {
  await matched(page, () => set(page, { method: "bm" }));
  const before = await page.evaluate(() => [...multiscopic.current().maps[0].bits]);
  const settings = await matched(page, () => set(page, { "num-disparities": 23 }));
  assert.equal(settings["num-disparities"], "23");
  const after = await page.evaluate(() => [...multiscopic.current().maps[0].bits]);
  assert(before.some((value, i) => value !== after[i]), "the map has changed");
  await assertIsMatch(page, "range");
});

await check("a slider is moved by keyboard", async () => {
  await page.focus("#option-block-size");
  await matched(page, () => page.keyboard.press("ArrowLeft"));
  assert.match(await page.$eval("#command", (node) => node.textContent), /--block-size 9 /);
  await assertIsMatch(page, "block");
});

const combinations = {
  "fusion and filters": { fusion: "mean", median: 5, "uniqueness-ratio": 10, "speckle-window-size": 60 },
  "semi-global matching by sad": { method: "sgm", fusion: "default", cost: "sad", "block-size": 7, p1: 5 },
  "semi-global matching by the census": { cost: "census2", paths: "8", "min-confidence": 0.5 },
  "the network, filled": { method: "net", fill: true },
  "graph cuts, with colours": { method: "gc", fill: false, "min-disparity": 10, "num-disparities": 6, sweeps: 1 },
};
for (const [name, settings] of Object.entries(combinations)) {
  await check(`${name}: the bits of match`, async () => {
    await matched(page, () => set(page, settings));
    await assertIsMatch(page, name);
  });
}

await check("a slow match ends when a slider moves", async () => {
  await set(page, { method: "gc", sweeps: 20, "num-disparities": 200, "min-confidence": 0 });
  await page.waitForFunction(() => /Matching/.test(document.getElementById("state").textContent));
  await new Promise((done) => setTimeout(done, 400));
  const start = performance.now();
  const settings = await matched(page, () => set(page, { method: "bm", "num-disparities": 30 }));
  assert.equal(settings.method, "bm", "the graph cuts were given up");
  console.log(`   block matching is there ${(performance.now() - start).toFixed(0)} ms later`);
});

await check("what a controller needs follows, and what it cannot do is said", async () => {
  const text = () => page.$eval("#prediction", (node) => node.textContent);
  const first = await text();
  assert.match(first, /KiB/);
  await matched(page, () => set(page, { "num-disparities": 60 }));
  assert.notEqual(await text(), first);
  await matched(page, () => page.select("#core", "cortex-m7"));
  await matched(page, () => set(page, { method: "net" }));
  assert.match(await page.$eval("#prediction-refusal", (node) => node.textContent), /does not run on microcontrollers/);
  await matched(page, () => set(page, { method: "bm" }));
});

await check("what makes no sense is said, and mended", async () => {
  await set(page, { method: "sgm", cost: "census", p1: 40, p2: 10 });
  await page.waitForFunction(() => !document.getElementById("failure").hidden);
  assert.match(await page.$eval("#failure", (node) => node.textContent), /P1.*40.*10|40.*10/);
  await matched(page, () => set(page, { p2: 50 }));
  assert(await page.$eval("#failure", (node) => node.hidden));
});

await check("the command and the code are copied", async () => {
  await browser.browser.defaultBrowserContext().overridePermissions(new URL(tune.address).origin, ["clipboard-read", "clipboard-write"]);
  await page.bringToFront();
  for (const [button, shown] of [["#copy-command", "#command"], ["#copy-rust", "#rust"]]) {
    await page.click(button);
    await page.waitForFunction(() => /copied/.test(document.getElementById("copied").textContent));
    const clipboard = await page.evaluate(() => navigator.clipboard.readText());
    assert.equal(clipboard, await page.$eval(shown, (node) => node.textContent));
  }
  assert.match(await page.$eval("#rust", (node) => node.textContent), /pub fn disparities/);
});

await check("another page shows the same, and what was looked at stays", async () => {
  await page.focus("#pane-first");
  await page.keyboard.press("+");
  const zoom = await page.evaluate(() => multiscopic.panes.zoom);
  const other = await tune.open(browser, [800, 900], "dark");
  const command = await page.$eval("#command", (node) => node.textContent);
  assert.equal(await other.page.$eval("#command", (node) => node.textContent), command);
  assert.equal(await other.page.$eval("#option-method", (node) => node.value), "sgm");
  await matched(page, () => matched(other.page, () => set(other.page, { method: "bm" })));
  assert.equal(await page.evaluate(() => multiscopic.panes.zoom), zoom);
  await other.page.close();
});

await check("in a narrow window, the controls stay below the picture", async () => {
  const { page } = await tune.open(browser, [390, 844], "light");
  const { bottom, covered, picture } = await page.evaluate(() => {
    const side = document.querySelector(".side");
    const { left, top, right, bottom } = side.getBoundingClientRect();
    let covered = 0;
    for (let y = top + 10; y < bottom - 5; y += 5) {
      for (let x = left + 10; x < right - 5; x += 10) covered += !side.contains(document.elementFromPoint(x, y));
    }
    return { bottom, covered, picture: document.getElementById("pane-first").getBoundingClientRect().top - top };
  });
  assert(bottom <= 844 && picture < -100, `the controls end at ${bottom}, and the picture begins ${-picture} above them`);
  assert.equal(covered, 0, "nothing lies on the controls");
  await page.close();
});

for (const [width, scheme] of [[1600, "dark"], [1100, "light"], [390, "light"], [390, "dark"]]) {
  await check(`no violation of accessibility at ${width} pixels, ${scheme}`, async () => {
    const { page } = await tune.open(browser, [width, 844], scheme);
    for (const method of ["bm", "sgm", "gc"]) {
      await matched(page, () => set(page, { method, "num-disparities": 16 }));
      await assertUsable(page, method);
    }
    await matched(page, () => set(page, { method: "sgm" }));
    await page.screenshot({ path: join(screenshots, `tune-${width}-${scheme}.png`), fullPage: true });
    await page.close();
  });
}
await page.close();
await tune.end();

const sets = join(folder, "sets");
const live = await Server.start(program, ["live", "--camera", "sim", "--stage", "sim", "--size", "160x120", "--baseline", "5", "--settle", "0.05", "-o", sets]);
const opened = async (size, scheme) => {
  const page = await browser.browser.newPage();
  page.on("console", (message) => ["error", "warn"].includes(message.type()) && browser.problems.push(message.text()));
  page.on("pageerror", (error) => browser.problems.push(String(error)));
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
  await page.setViewport({ width: size[0], height: size[1] });
  await page.goto(live.address);
  await page.waitForFunction(() => !document.getElementById("preview").hidden);
  return page;
};

await check("the camera is seen, with its measures", async () => {
  const page = await opened([1400, 1000], "light");
  const [width, focus, histogram] = await page.evaluate(() => [
    document.getElementById("preview").naturalWidth,
    document.getElementById("focus-value").textContent,
    document.getElementById("histogram-line").getAttribute("d"),
  ]);
  assert.equal(width, 160);
  assert(Number(focus.match(/^[\d.]+/)[0]) > 0, focus);
  assert(histogram.length > 200);
  const first = await page.$eval("#preview", (image) => image.src);
  await page.waitForFunction((first) => document.getElementById("preview").src !== first, {}, first);
  await assertUsable(page, "without a set");
  await page.screenshot({ path: join(screenshots, "live-empty.png"), fullPage: true });
  await page.close();
});

await check("a set is taken, its steps are told, and it is matched", async () => {
  const page = await opened([1400, 1000], "dark");
  const steps = page.evaluate(() => new Promise((done) => {
    const steps = new Set();
    const state = document.getElementById("capture-state");
    new MutationObserver(() => {
      steps.add(state.textContent);
      if (/is taken/.test(state.textContent)) done([...steps]);
    }).observe(state, { childList: true });
  }));
  await matched(page, () => page.click("#take"));
  assert((await steps).some((step) => /(moving|settling|capturing|captured|returning)/.test(step)), await steps);
  assert.deepEqual(readdirSync(sets), ["0001"]);
  await showsNet(page);
  await assertIsMatch(page, "the set");
  await matched(page, () => page.click("#take"));
  await showsNet(page);
  await page.waitForFunction(() => document.getElementById("history").options.length === 2);
  assert.equal(await page.$eval("#history", (list) => list.value), "0002");
  await page.screenshot({ path: join(screenshots, "live-wide-dark.png"), fullPage: true });
  const before = await page.$eval("#command", (node) => node.textContent);
  await matched(page, () => page.select("#history", "0001"));
  assert.match(before, /0002/);
  assert.match(await page.$eval("#command", (node) => node.textContent), /0001/);
  await page.close();
});

for (const [width, scheme] of [[390, "light"], [1600, "dark"]]) {
  await check(`no violation of accessibility beside a camera at ${width} pixels, ${scheme}`, async () => {
    const page = await opened([width, 844], scheme);
    await page.waitForSelector("html[data-viewer=ready]");
    await assertUsable(page, "live");
    await page.screenshot({ path: join(screenshots, `live-${width}-${scheme}.png`), fullPage: true });
    await page.close();
  });
}
await live.end();
await browser.close();
console.log("the live view: every check passed");
