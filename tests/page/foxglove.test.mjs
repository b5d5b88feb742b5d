// Reads what `--foxglove` publishes with Foxglove's own client and decoders. Arguments: the program, a rig, an empty folder.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { Server } from "./browser.mjs";

// These are CommonJS.
const require = createRequire(import.meta.url);
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const WebSocket = require("ws");

const [program, rig, folder] = process.argv.slice(2);

// The points of a cloud as text: x, y, z, red, green, blue, confidence.
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
  return { x: float("x"), y: float("y"), z: float("z"), red, green, blue, confidence: float("confidence") };
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

const [cloud, confidences] = ["cloud.ply", "confidence.png"].map((name) => join(folder, name));
execFileSync(program, ["--quiet", "match", rig, "--ply", cloud, "--ply-ascii", "--confidence", confidences], { stdio: "inherit" });
const expected = readPly(cloud);

const server = await Server.start(program, ["tune", rig, "--foxglove", "127.0.0.1:0"]);
const topics = ["/camera/image", "/camera/camera_info", "/depth/image", "/disparity", "/points", "/confidence/image"];
// The map by blocks comes first, and then that of `match`: whoever comes later gets the newest.
const isLast = ({ message }) => message.width === expected.length && Math.abs(pointOf(message, 0).z - expected[0].z) < 1e-6;
let found;
do {
  found = await subscribed(server.published, topics);
} while (!isLast(found["/points"]));

const points = found["/points"].message;
assert.equal(found["/points"].schemaName, "sensor_msgs/msg/PointCloud2");
expected.forEach((point, i) => {
  const found = pointOf(points, i);
  for (const name of ["red", "green", "blue"]) assert.equal(found[name], point[name], `${name} of point ${i}`);
  for (const name of ["x", "y", "z"]) assert(Math.abs(found[name] - point[name]) < 1e-6, `${name} of point ${i}`);
  assert(Math.abs(255 * found.confidence - point.confidence) < 1e-3, `confidence of point ${i}`);
});
const stamps = Object.values(found).map(({ message: { header } }) => `${header.frame_id} ${header.stamp.sec}.${header.stamp.nanosec}`);
assert.equal(new Set(stamps).size, 1, "all are from one moment, in one frame");
const info = found["/camera/camera_info"].message;
assert.equal(info.width, found["/camera/image"].message.width);
console.log(`ok: Foxglove's client reads ${expected.length} points, as match writes them`);
await server.end();
