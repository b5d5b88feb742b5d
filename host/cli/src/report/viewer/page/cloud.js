// A point cloud to turn, zoom and measure in. It is drawn without the graphics processor, so that it looks the same everywhere.

import { point } from "viewer/numbers.js";

const PICK_REACH = 12;

export class Cloud {
  constructor(canvas, onMeasure) {
    this.canvas = canvas;
    this.onMeasure = onMeasure;
    this.points = null;
    this.listen();
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  // The points of a map with the colours of the centre. Another map of the same scene is seen from the same place.
  show({ width, geometry }, bits, colors) {
    const [places, shades] = [[], []];
    for (let i = 0; i < bits.length; i++) {
      const place = point(i % width, Math.floor(i / width), bits[i], geometry);
      if (place) {
        places.push(...place);
        shades.push(colors[i]);
      }
    }
    const isNew = this.points === null;
    this.points = Float32Array.from(places);
    this.shades = Int32Array.from(shades);
    this.focal = geometry.focal_px / width;
    if (!isNew) {
      this.clear();
      this.draw();
      return;
    }
    const depths = Float32Array.from({ length: shades.length }, (_, i) => this.points[3 * i + 2]).sort();
    this.pivot = [0, 0, depths.length ? depths[Math.floor(depths.length / 2)] : 1];
    this.reset();
  }

  reset() {
    Object.assign(this, { yaw: 0.25, pitch: 0.12, zoom: 1, shift: [0, 0] });
    this.clear();
    this.draw();
  }

  clear() {
    this.picked = [];
    this.onMeasure([]);
  }

  // How a place is turned about the pivot, as the viewer sees it.
  turned() {
    const [sinY, cosY, sinP, cosP] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    const [px, py, pz] = this.pivot;
    return (x, y, z) => {
      const [a, b, c] = [x - px, y - py, z - pz];
      const depth = cosY * c - sinY * a;
      return [cosY * a + sinY * c, cosP * b - sinP * depth, sinP * b + cosP * depth + pz];
    };
  }

  // Where a place is on the canvas, and how deep; null behind the viewer.
  projection() {
    const { width, height } = this.canvas;
    const turn = this.turned();
    const focal = this.focal * width * this.zoom;
    const [left, top] = [width / 2 + this.shift[0] * width, height / 2 + this.shift[1] * width];
    return (x, y, z) => {
      const [a, b, depth] = turn(x, y, z);
      return depth > 0.01 ? [left + (focal * a) / depth, top + (focal * b) / depth, depth] : null;
    };
  }

  draw() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = undefined;
      if (!this.points || this.canvas.hidden) return;
      this.drawNow();
    });
  }

  drawNow() {
    const { canvas, points, shades } = this;
    const [width, height] = [Math.max(1, canvas.clientWidth), Math.max(1, canvas.clientHeight)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    const image = context.createImageData(width, height);
    const pixels = new Int32Array(image.data.buffer);
    const nearest = new Float32Array(width * height).fill(Infinity);
    // While it moves, a large cloud is thinned.
    const step = this.isMoving ? Math.ceil(shades.length / 250_000) : 1;
    const [sinY, cosY, sinP, cosP] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    const [px, py, pz] = this.pivot;
    const focal = this.focal * width * this.zoom;
    const [left, top] = [width / 2 + this.shift[0] * width, height / 2 + this.shift[1] * width];
    const across = Math.sqrt((step * width * height) / Math.max(1, shades.length));
    for (let i = 0; i < shades.length; i += step) {
      const [a, b, c] = [points[3 * i] - px, points[3 * i + 1] - py, points[3 * i + 2] - pz];
      const behind = cosY * c - sinY * a;
      const depth = sinP * b + cosP * behind + pz;
      if (depth < 0.01) continue;
      const x = left + (focal * (cosY * a + sinY * c)) / depth;
      const y = top + (focal * (cosP * b - sinP * behind)) / depth;
      // A point is as wide as the pixel that saw it.
      const side = Math.min(12, Math.max(1, Math.ceil((1.7 * across * this.zoom * points[3 * i + 2]) / depth)));
      const [fromX, fromY] = [Math.max(0, Math.round(x - side / 2)), Math.max(0, Math.round(y - side / 2))];
      const [toX, toY] = [Math.min(width, fromX + side), Math.min(height, fromY + side)];
      for (let row = fromY; row < toY; row++) {
        for (let at = row * width + fromX; at < row * width + toX; at++) {
          if (depth < nearest[at]) {
            nearest[at] = depth;
            pixels[at] = shades[i];
          }
        }
      }
    }
    context.putImageData(image, 0, 0);
    this.drawPicked(context);
  }

  drawPicked(context) {
    const project = this.projection();
    const places = this.picked.map((index) => project(...this.points.subarray(3 * index, 3 * index + 3))).filter(Boolean);
    for (const [color, wide] of [["#000", 5], ["#fff", 2]]) {
      context.strokeStyle = color;
      context.lineWidth = wide;
      context.beginPath();
      places.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      for (const [x, y] of places) {
        context.moveTo(x + 6, y);
        context.arc(x, y, 6, 0, 2 * Math.PI);
      }
      context.stroke();
    }
  }

  // Picks the point nearest to the viewer within reach of a place on the canvas.
  pick(x, y) {
    if (!this.points) return;
    const project = this.projection();
    let best = null;
    for (let i = 0; i < this.shades.length; i++) {
      const at = project(this.points[3 * i], this.points[3 * i + 1], this.points[3 * i + 2]);
      const distance = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (distance > PICK_REACH) continue;
      // A pixel off counts as one percent of the depth.
      const rank = at[2] * (1 + distance / 100);
      if (!best || rank < best.rank) best = { i, rank };
    }
    if (!best) return;
    if (this.picked.length === 2) this.picked = [];
    this.picked.push(best.i);
    this.onMeasure(this.picked.map((i) => [...this.points.subarray(3 * i, 3 * i + 3)]));
    this.draw();
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(1.5, Math.max(-1.5, this.pitch + pitch));
    this.draw();
  }

  zoomBy(factor) {
    this.zoom = Math.min(40, Math.max(0.2, this.zoom * factor));
    this.draw();
  }

  listen() {
    const { canvas } = this;
    const pointers = new Map();
    let hasMoved = false;
    canvas.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      canvas.setPointerCapture(event.pointerId);
      hasMoved = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const at = [event.clientX, event.clientY];
      const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
      if (!hasMoved && Math.hypot(dx, dy) < 3) return;
      hasMoved = this.isMoving = true;
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      pointers.set(event.pointerId, at);
      if (other) {
        const distance = ([x, y]) => Math.hypot(x - other[0], y - other[1]);
        this.zoomBy(distance(at) / Math.max(1, distance(before)));
      } else if (event.shiftKey || event.buttons === 2) {
        this.shift = [this.shift[0] + dx / canvas.clientWidth, this.shift[1] + dy / canvas.clientWidth];
        this.draw();
      } else {
        this.turn(-dx / 200, dy / 200);
      }
    });
    const release = (event) => {
      if (pointers.delete(event.pointerId) && !hasMoved && event.type === "pointerup") {
        const box = canvas.getBoundingClientRect();
        this.pick(event.clientX - box.left, event.clientY - box.top);
      }
      this.isMoving = false;
      this.draw();
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY / 400));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const actions = {
        ArrowLeft: () => this.turn(0.1, 0),
        ArrowRight: () => this.turn(-0.1, 0),
        ArrowUp: () => this.turn(0, -0.1),
        ArrowDown: () => this.turn(0, 0.1),
        "+": () => this.zoomBy(1.25),
        "=": () => this.zoomBy(1.25),
        "-": () => this.zoomBy(0.8),
        0: () => this.reset(),
        m: () => this.pick(canvas.width / 2, canvas.height / 2),
      };
      const action = event.ctrlKey || event.metaKey || event.altKey ? undefined : actions[event.key];
      if (action) {
        event.preventDefault();
        action();
      }
    });
  }
}
