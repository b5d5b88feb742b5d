// Reads what `--foxglove` publishes with Foxglove's own client and decoders. Arguments: the program, a rig, an empty folder.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { Server, readPfm } from "./browser.mjs";

// These are CommonJS.
const require = createRequire(import.meta.url);
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const WebSocket = require("ws");

const [program, rig, folder] = process.argv.slice(2);

// The points of a cloud as text: x, y, z, red, green, blue, confidence, sigma.
function readPly(path) {
  const [header, body] = readFileSync(path, "latin1").split("end_header\n");
  const count = Number(header.match(/element vertex (\d+)/)[1]);
  const names = [...header.matchAll(/property \w+ (\w+)/g)].map(([, name]) => name);
  const rows = body.trimEnd().split("\n").map((line) => Object.fromEntries(line.split(" ").map((word, i) => [names[i], Number(word)])));
  assert.equal(rows.length, count);
  return rows;
}

// The fields of a point of a `PointCloud2`.
function pointOf({ data, fields, point_step }, index) {
  const view = new DataView(data.buffer, data.byteOffset + index * point_step, point_step);
  const place = Object.fromEntries(fields.map(({ name, offset }) => [name, offset]));
  const float = (name) => view.getFloat32(place[name], true);
  const [blue, green, red] = [0, 1, 2].map((byte) => view.getUint8(place.rgb + byte));
  return { x: float("x"), y: float("y"), z: float("z"), red, green, blue, confidence: float("confidence"), sigma: float("sigma") };
}

// Subscribes to all topics, and resolves once each has sent a message.
function subscribed(address, topics) {
  const client = new FoxgloveClient({ ws: new WebSocket(address, ["foxglove.sdk.v1"]) });
  const [readers, found] = [new Map(), {}];
  return new Promise((done, fail) => {
    client.on("error", fail);
    client.on("advertise", (channels) => {
      for (const { id, topic, encoding, schema, schemaName, schemaEncoding } of channels) {
        assert.deepEqual([encoding, schemaEncoding], ["cdr", "ros2msg"], topic);
        readers.set(client.subscribe(id), { topic, schemaName, reader: new MessageReader(parse(schema, { ros2: true })) });
      }
    });
    client.on("message", ({ subscriptionId, timestamp, data }) => {
      const { topic, schemaName, reader } = readers.get(subscriptionId);
      found[topic] = { schemaName, timestamp, message: reader.readMessage(data) };
      if (topics.every((topic) => topic in found)) {
        client.close();
        done(found);
      }
    });
  });
}

// What `tune` publishes of a rig, once its cloud is that of `match`, and the points of that.
async function published(rig, topics) {
  const [cloud, confidences, sigmas] = ["cloud.ply", "confidence.png", "sigma.pfm"].map((name) => join(folder, name));
  const files = ["--ply", cloud, "--ply-ascii", "--confidence", confidences, "--sigma", sigmas];
  execFileSync(program, ["--quiet", "match", rig, ...files], { stdio: "inherit" });
  const expected = readPly(cloud);
  const server = await Server.start(program, ["tune", rig, "--foxglove", "127.0.0.1:0"]);
  // The map by blocks comes first, and then that of `match`: whoever comes later gets the newest.
  const isLast = ({ message }) => message.width === expected.length && Math.abs(pointOf(message, 0).z - expected[0].z) < 1e-6;
  let found;
  do {
    found = await subscribed(server.published, topics);
  } while (!isLast(found["/points"]));
  await server.end();
  return { expected, found };
}

const maps = ["/camera/image", "/camera/camera_info", "/depth/image", "/disparity", "/points", "/confidence/image"];
const { expected, found } = await published(rig, maps);
const points = found["/points"].message;
assert.equal(found["/points"].schemaName, "sensor_msgs/msg/PointCloud2");
expected.forEach((point, i) => {
  const found = pointOf(points, i);
  for (const name of ["red", "green", "blue"]) assert.equal(found[name], point[name], `${name} of point ${i}`);
  for (const name of ["x", "y", "z"]) assert(Math.abs(found[name] - point[name]) < 1e-6, `${name} of point ${i}`);
  assert(Math.abs(255 * found.confidence - point.confidence) < 1e-3, `confidence of point ${i}`);
  assert(Math.abs(found.sigma - point.sigma) <= 1e-6 * point.sigma, `sigma of point ${i}`);
});
const stamps = Object.values(found).map(({ message: { header } }) => `${header.frame_id} ${header.stamp.sec}.${header.stamp.nanosec}`);
assert.equal(new Set(stamps).size, 1, "all are from one moment, in one frame");
const info = found["/camera/camera_info"].message;
assert.equal(info.width, found["/camera/image"].message.width);
console.log(`ok: Foxglove's client reads ${expected.length} points, as match writes them`);

// A camera on an arm, 50 mm beside its tool and tilted against it. Rectified frames have the axes of the tool.
const [onTool, tilt] = [[50, -20, 30], [1.2, -0.9, 0]];
const [toolAt, toolTurn] = [[400, -200, 700], [150, 40, -20]];
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];

// A vector that is turned about an axis by its length in degrees (Rodrigues' formula).
function turned(axisDeg, v) {
  const degrees = Math.hypot(...axisDeg);
  const axis = axisDeg.map((x) => x / degrees);
  const [cos, sin] = [Math.cos, Math.sin].map((f) => f((degrees * Math.PI) / 180));
  const [across, along] = [cross(axis, v), dot(axis, v) * (1 - cos)];
  return v.map((x, i) => x * cos + across[i] * sin + axis[i] * along);
}

// A vector that is turned by a unit quaternion.
function rotated({ x, y, z, w }, v) {
  const t = cross([x, y, z], v).map((a) => 2 * a);
  const u = cross([x, y, z], t);
  return v.map((a, i) => a + w * t[i] + u[i]);
}

const file = (name) => join(folder, name);
writeFileSync(file("sim.toml"), `[mount]\nrotation_deg = ${JSON.stringify(tilt)}\n`);
writeFileSync(file("hand_eye.toml"), `translation_mm = ${JSON.stringify(onTool)}\nrotation_deg = ${JSON.stringify(tilt)}\n`);
const axes = [[1, 0, 0], [0, 1, 0]].map((axis) => turned(toolTurn, axis));
writeFileSync(file("arm.mjs"), `
import { createInterface } from "node:readline";
let place = [0, 0];
for await (const line of createInterface({ input: process.stdin })) {
  const [order, ...numbers] = line.split(" ");
  if (order === "move") place = numbers.map(Number);
  const [right, down] = ${JSON.stringify(axes)};
  const tool = ${JSON.stringify(toolAt)}.map((at, i) => at + place[0] * right[i] + place[1] * down[i]);
  console.log(order === "where" ? ["ok", ...place, ...tool, ...${JSON.stringify(toolTurn)}].join(" ") : "ok");
}
`);
const hardware = ["--camera", `sim:${file("sim.toml")}`, "--stage", `exec:'${process.execPath}' '${file("arm.mjs")}'`, "--hand-eye", file("hand_eye.toml")];
const sequence = ["--baseline", "20", "--views", "4", "--settle", "0", "--size", "320x240", "-o", file("armed")];
execFileSync(program, ["--quiet", "capture", ...hardware, ...sequence], { stdio: "inherit" });

const armed = (await published(file("armed"), [...maps, "/tf", "/tf_static"])).found;
const links = ["/tf", "/tf_static"].flatMap((topic) => armed[topic].message.transforms);
// From the frame of the cloud up to the base.
const chain = [];
for (let frame = armed["/points"].message.header.frame_id; frame !== "base"; frame = chain.at(-1).header.frame_id) {
  const link = links.find(({ child_frame_id }) => child_frame_id === frame);
  assert(link && chain.length < links.length, `no way from ${frame} to the base`);
  chain.push(link);
}
const inBase = (point) => chain.reduce((p, { transform: { translation, rotation } }) => {
  const [x, y, z] = rotated(rotation, p);
  return [x + translation.x, y + translation.y, z + translation.z];
}, point);

// The known scene: from the base to rectified frames by the poses above, and there to a pixel and its true disparity.
const { p } = armed["/camera/camera_info"].message;
const [focal, cx, cy] = [p[0], p[2], p[6]];
const truth = readPfm(join(file("armed"), "truth.pfm"));
let [count, within, offPixel] = [0, 0, 0];
for (let i = 0; i < armed["/points"].message.width; i++) {
  const { x, y, z, sigma } = pointOf(armed["/points"].message, i);
  const fromTool = inBase([x, y, z]).map((metres, axis) => 1000 * metres - toolAt[axis]);
  const [right, down, depth] = turned(toolTurn.map((x) => -x), fromTool).map((mm, axis) => mm - onTool[axis]);
  const [u, v] = [(focal * right) / depth + cx, (focal * down) / depth + cy];
  // Each point is what the middle of a pixel shows.
  offPixel = Math.max(offPixel, Math.abs(u - Math.round(u)), Math.abs(v - Math.round(v)));
  const disparity = truth.at(Math.round(u), Math.round(v));
  if (!Number.isFinite(disparity)) continue;
  count++;
  within += Math.abs(depth - (focal * 20) / disparity) <= 2000 * sigma;
}
assert(offPixel < 0.02, `${offPixel} pixels beside the rays of pixels`);
assert(count > 60_000 && within > 0.95 * count, `${within} of ${count} points are within two sigma`);
console.log(`ok: Foxglove's client finds ${count} points in the frame of the arm's base, ${within} of them within two sigma of the scene`);
