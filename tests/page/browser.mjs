// A headless browser, pages in it, servers of the program, and what tests look at.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { createInterface } from "node:readline";
import puppeteer from "puppeteer-core";

// The milliseconds after which something counts as hung.
const PATIENCE_MS = 180_000;

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

// A PFM file, read without the program: rows from the bottom up.
export function readPfm(path) {
  const bytes = readFileSync(path);
  let place = 0;
  const word = () => {
    const start = place;
    while (bytes[place] > 32) place++;
    return bytes.toString("latin1", start, place++);
  };
  assert.equal(word(), "Pf");
  const [width, height, scale] = [Number(word()), Number(word()), Number(word())];
  assert(scale < 0, "little-endian");
  return { width, height, at: (u, v) => bytes.readFloatLE(place + 4 * ((height - 1 - v) * width + u)) };
}

export class Browser {
  // Everything that pages complain about.
  problems = [];

  static async launch(path) {
    const browser = new Browser();
    browser.browser = await puppeteer.launch({ executablePath: path, headless: true, args: ["--no-sandbox", "--disable-gpu", "--force-color-profile=srgb"] });
    return browser;
  }

  // A page of a width with a colour scheme, once it shows something. It may ask for what begins with one of `own`, and for
  // nothing else. `work()` tells for how many seconds its main thread has run, which does not depend on what else the machine
  // does.
  async open(address, [width, height], scheme, own) {
    const page = await this.browser.newPage();
    // Only what never comes takes so long.
    page.setDefaultTimeout(PATIENCE_MS);
    page.on("console", (message) => ["error", "warn"].includes(message.type()) && this.problems.push(message.text()));
    page.on("pageerror", (error) => this.problems.push(String(error)));
    page.on("request", (request) => {
      const isOwn = /^(data|blob):/.test(request.url()) || own.some((start) => request.url().startsWith(start));
      if (!isOwn) this.problems.push(`a request to ${request.url()}`);
    });
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    await page.setViewport({ width, height });
    const session = await page.createCDPSession();
    await session.send("Performance.enable", { timeDomain: "threadTicks" });
    const work = async () => (await session.send("Performance.getMetrics")).metrics.find(({ name }) => name === "TaskDuration").value;
    await page.goto(address);
    await page.waitForSelector("html[data-viewer=ready]");
    return { page, work };
  }

  async check(name, run) {
    await run();
    assert.deepEqual(this.problems, [], name);
    console.log(`ok: ${name}`);
  }

  close() {
    return this.browser.close();
  }
}

// A server of the program.
export class Server {
  // Starts it. It is there once it has told the address of its page.
  static async start(program, words) {
    const server = new Server();
    server.process = spawn(program, [...words, "--no-open"], { stdio: ["ignore", "inherit", "pipe"] });
    process.on("exit", () => server.process.kill("SIGKILL"));
    server.ended = new Promise((done) => server.process.on("exit", (code) => done(code)));
    const lines = createInterface({ input: server.process.stderr });
    server.address = await new Promise((done, fail) => {
      lines.on("line", (line) => {
        const found = line.match(/(open|publishing at) ((?:http|ws):\S+)/);
        if (found?.[1] === "open") done(found[2]);
        else if (found) server.published = found[2];
        else console.error(line);
      });
      server.ended.then((code) => fail(new Error(`the server has ended with ${code}`)));
    });
    return server;
  }

  open(browser, size, scheme) {
    return browser.open(this.address, size, scheme, [this.address, new URL("/favicon.ico", this.address).href]);
  }

  async end() {
    this.process.kill("SIGINT");
    assert.equal(await this.ended, 130, "Ctrl-C ends the server");
  }
}

export const settled = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));

// The colours of a canvas.
export async function pixels(page, id) {
  await settled(page);
  return page.$eval(id, (canvas) => {
    const { width, height } = canvas;
    const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(canvas, 0, 0);
    return [...copy.getImageData(0, 0, width, height).data];
  });
}

// The share of pixels that differ, between two shares of the width.
export function changed(before, after, [from, to] = [0, 1], width = 0) {
  let [count, different] = [0, 0];
  for (let i = 0; i < before.length; i += 4) {
    const column = width ? ((i / 4) % width) / width : from;
    if (column < from || column > to) continue;
    count++;
    if (before[i] !== after[i] || before[i + 1] !== after[i + 1] || before[i + 2] !== after[i + 2]) different++;
  }
  return different / count;
}

// Fails if someone cannot use the page as it is, or if it is wider than its window.
export async function assertUsable(page, name) {
  await settled(page);
  // The page's policy forbids scripts of others but for the tests'.
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => axe.run());
  const told = violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html.slice(0, 120)).join(" | ")}`);
  assert.deepEqual(told, [], name);
  const overflow = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  assert(overflow <= 0, `${name} is ${overflow} pixels too wide`);
}
