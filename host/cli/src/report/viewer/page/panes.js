// Pictures that are zoomed and moved together, with a cursor.

const DIVIDER_REACH = 14;

export class Panes {
  // `onCursor` is told where the cursor is, `onDivide` where the divider is, in percent.
  constructor(canvases, { onCursor, onDivide, onSwap }) {
    this.canvases = canvases;
    this.layers = [];
    this.mode = "single";
    this.cut = 50;
    this.cursor = null;
    Object.assign(this, { onCursor, onDivide, onSwap });
    this.fit();
    for (const canvas of canvases) this.listen(canvas);
    new ResizeObserver(() => this.draw()).observe(canvases[0].parentElement);
  }

  resize(width, height) {
    this.size = [width, height];
    this.cursor = null;
    for (const canvas of this.canvases) canvas.style.aspectRatio = `${width} / ${height}`;
    this.fit();
  }

  fit() {
    this.zoom = 1;
    this.middle = [0.5, 0.5];
    this.draw();
  }

  // Zooms by a factor and keeps the place at a share of the canvas where it is.
  zoomBy(factor, at = [0.5, 0.5]) {
    const zoom = Math.min(64, Math.max(1, this.zoom * factor));
    this.middle = this.middle.map((middle, axis) => middle + (at[axis] - 0.5) * (1 / this.zoom - 1 / zoom));
    this.zoom = zoom;
    this.keepInside();
  }

  moveBy(shares) {
    this.middle = this.middle.map((middle, axis) => middle - shares[axis] / this.zoom);
    this.keepInside();
  }

  keepInside() {
    const half = 0.5 / this.zoom;
    this.middle = this.middle.map((middle) => Math.min(1 - half, Math.max(half, middle)));
    for (const canvas of this.canvases) canvas.style.touchAction = this.zoom > 1 ? "none" : "pan-y";
    this.draw();
  }

  // The pixel at a share of the canvas.
  pixelAt(shares) {
    return shares.map((share, axis) => {
      const place = this.middle[axis] + (share - 0.5) / this.zoom;
      return Math.min(this.size[axis] - 1, Math.max(0, Math.floor(place * this.size[axis])));
    });
  }

  moveCursor(pixel) {
    this.cursor = pixel.map((place, axis) => Math.min(this.size[axis] - 1, Math.max(0, place)));
    this.draw();
    this.onCursor(this.cursor);
  }

  listen(canvas) {
    const pointers = new Map();
    let isDividing = false;
    let hasMoved = false;
    const shares = (event) => {
      const box = canvas.getBoundingClientRect();
      return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    };
    const nearDivider = (event) => {
      const box = canvas.getBoundingClientRect();
      return this.mode === "divide" && Math.abs(event.clientX - box.left - (this.cut / 100) * box.width) < DIVIDER_REACH;
    };
    canvas.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, shares(event));
      canvas.setPointerCapture(event.pointerId);
      isDividing = nearDivider(event);
      hasMoved = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      const at = shares(event);
      const before = pointers.get(event.pointerId);
      canvas.style.cursor = isDividing || nearDivider(event) ? "ew-resize" : "crosshair";
      if (!before) {
        this.moveCursor(this.pixelAt(at));
        return;
      }
      const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      pointers.set(event.pointerId, at);
      hasMoved = true;
      if (isDividing) {
        this.onDivide(Math.min(100, Math.max(0, 100 * at[0])));
      } else if (others.length) {
        const distance = ([x, y]) => Math.hypot(x - others[0][0], y - others[0][1]);
        this.zoomBy(distance(at) / Math.max(distance(before), 0.01), at);
      } else {
        this.moveBy([at[0] - before[0], at[1] - before[1]]);
      }
    });
    const release = (event) => {
      if (pointers.delete(event.pointerId) && !hasMoved && event.type === "pointerup") this.moveCursor(this.pixelAt(shares(event)));
      isDividing = false;
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY / 300), shares(event));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 10 : 1;
      const [u, v] = this.cursor ?? this.pixelAt([0.5, 0.5]);
      const actions = {
        ArrowLeft: () => this.moveCursor([u - step, v]),
        ArrowRight: () => this.moveCursor([u + step, v]),
        ArrowUp: () => this.moveCursor([u, v - step]),
        ArrowDown: () => this.moveCursor([u, v + step]),
        "+": () => this.zoomBy(1.5),
        "=": () => this.zoomBy(1.5),
        "-": () => this.zoomBy(1 / 1.5),
        0: () => this.fit(),
        b: () => this.onSwap(),
      };
      const action = event.ctrlKey || event.metaKey || event.altKey ? undefined : actions[event.key];
      if (action) {
        event.preventDefault();
        action();
      }
    });
  }

  draw() {
    // One drawing for each frame of the screen.
    this.pending ??= requestAnimationFrame(() => {
      this.pending = undefined;
      if (this.mode === "cloud") return;
      this.drawOn(this.canvases[0], this.layers[0], this.mode === "divide" ? this.layers[1] : undefined);
      if (this.mode === "beside") this.drawOn(this.canvases[1], this.layers[1]);
    });
  }

  drawOn(canvas, layer, second) {
    if (!layer || canvas.clientWidth === 0) return;
    const ratio = window.devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.round(side * ratio));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    const scale = (width / this.size[0]) * this.zoom;
    const [left, top] = [0, 1].map((axis) => [width, height][axis] / 2 - this.middle[axis] * this.size[axis] * scale);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    context.setTransform(scale, 0, 0, scale, left, top);
    context.imageSmoothingEnabled = scale < 1;
    context.drawImage(layer, 0, 0, ...this.size);
    context.setTransform(1, 0, 0, 1, 0, 0);
    if (second) {
      const cut = (this.cut / 100) * width;
      context.save();
      context.beginPath();
      context.rect(cut, 0, width - cut, height);
      context.clip();
      context.setTransform(scale, 0, 0, scale, left, top);
      context.drawImage(second, 0, 0, ...this.size);
      context.restore();
      context.fillStyle = "#000";
      context.fillRect(cut - 2 * ratio, 0, 4 * ratio, height);
      context.fillStyle = "#fff";
      context.fillRect(cut - ratio, 0, 2 * ratio, height);
      context.beginPath();
      context.arc(cut, height / 2, 9 * ratio, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }
    if (this.cursor) this.drawCursor(context, [left, top], scale, ratio);
  }

  drawCursor(context, [left, top], scale, ratio) {
    const [x, y] = [left + (this.cursor[0] + 0.5) * scale, top + (this.cursor[1] + 0.5) * scale];
    const inner = Math.max(4 * ratio, scale / 2 + 2);
    const outer = inner + 9 * ratio;
    for (const [color, wide] of [["#000", 4], ["#fff", 1.6]]) {
      context.strokeStyle = color;
      context.lineWidth = wide * ratio;
      context.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        context.moveTo(x + dx * inner, y + dy * inner);
        context.lineTo(x + dx * outer, y + dy * outer);
      }
      context.stroke();
    }
  }
}
