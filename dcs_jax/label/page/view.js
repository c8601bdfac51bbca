// The frame and its boxes: zoom, pan, draw, drag, resize; mouse, pen and fingers.

const SMALLEST = 4; // pixels of the frame, as the tracker has it
const HANDLES = [[0, 0], [0.5, 0], [1, 0], [1, 0.5], [1, 1], [0.5, 1], [0, 1], [0, 0.5]];
const CURSORS = ["nwse", "ns", "nesw", "ew", "nwse", "ns", "nesw", "ew"];
const MOST_ZOOM = 40;

export const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);

export class View {
  #model;
  #frames;
  #canvas = document.querySelector("#view");
  #scale = 1;
  #x = 0; // of the frame's corner, pixels of the page
  #y = 0;
  #fitted = true;
  #pointers = new Map();
  #drag = null; // what is done with the pointer: { kind, box, ... }
  #sent = null; // an edit that the server has not confirmed: { id, frame, box }
  #hover = null;
  #mode = null; // what the next drag draws, wherever it begins: a "new" object, or the chosen one "again"

  constructor(model, frames) {
    this.#model = model;
    this.#frames = frames;
    const canvas = this.#canvas;
    new ResizeObserver(() => this.#resize()).observe(canvas);
    frames.addEventListener("shown", () => this.#shown());
    model.addEventListener("change", ({ detail }) => {
      if (detail === "objects" || detail === "error") this.#sent = null;
      if (detail === "clip") this.fit();
      this.draw();
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#up(event));
    canvas.addEventListener("pointercancel", (event) => this.#cancel(event));
    canvas.addEventListener("pointerleave", () => this.#setHover(null));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
  }

  // ---- what is seen

  fit() {
    const { clip } = this.#model;
    if (!clip) return;
    const { clientWidth: w, clientHeight: h } = this.#canvas;
    const margin = 16;
    this.#scale = Math.min((w - 2 * margin) / clip.width, (h - 2 * margin) / clip.height, MOST_ZOOM);
    this.#scale = Math.max(this.#scale, 0.01);
    this.#x = (w - this.#scale * clip.width) / 2;
    this.#y = (h - this.#scale * clip.height) / 2;
    this.#fitted = true;
    this.draw();
  }

  zoom(factor, x = this.#canvas.clientWidth / 2, y = this.#canvas.clientHeight / 2) {
    const scale = Math.max(0.02, Math.min(MOST_ZOOM, this.#scale * factor));
    this.#x = x - ((x - this.#x) * scale) / this.#scale;
    this.#y = y - ((y - this.#y) * scale) / this.#scale;
    this.#scale = scale;
    this.#fitted = false;
    this.#keepInSight();
    this.draw();
  }

  #keepInSight() {
    const { clip } = this.#model;
    const { clientWidth: w, clientHeight: h } = this.#canvas;
    this.#x = Math.max(60 - clip.width * this.#scale, Math.min(w - 60, this.#x));
    this.#y = Math.max(60 - clip.height * this.#scale, Math.min(h - 60, this.#y));
  }

  #resize() {
    const ratio = devicePixelRatio;
    this.#canvas.width = this.#canvas.clientWidth * ratio;
    this.#canvas.height = this.#canvas.clientHeight * ratio;
    if (this.#fitted) this.fit();
    this.draw();
  }

  #shown() {
    const other = this.#drag && "frame" in this.#drag && this.#drag.frame !== this.#frames.shown;
    if (other) this.#drag = null;
    this.draw();
  }

  #waiting = false;

  draw() {
    if (this.#waiting) return;
    this.#waiting = true;
    requestAnimationFrame(() => {
      this.#waiting = false;
      this.#paint();
    });
  }

  #paint() {
    const { clip } = this.#model;
    const context = this.#canvas.getContext("2d");
    const ratio = devicePixelRatio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.#canvas.clientWidth, this.#canvas.clientHeight);
    if (!clip) return;
    const [w, h] = [clip.width * this.#scale, clip.height * this.#scale];
    context.fillStyle = "#000";
    context.fillRect(this.#x, this.#y, w, h);
    const { image, shown } = this.#frames;
    if (image) {
      context.imageSmoothingEnabled = this.#scale < 3;
      context.imageSmoothingQuality = "high";
      context.drawImage(image, this.#x, this.#y, w, h);
    }
    document.querySelector("#zoom-level").textContent = `${Math.round(100 * this.#scale)} %`;
    if (shown === null) return;
    this.#canvas.dataset.frame = shown;
    const chosen = this.#model.chosen;
    for (const object of this.#model.objects.values())
      if (object !== chosen) this.#paintObject(context, object, false);
    if (chosen) this.#paintObject(context, chosen, true);
    if (this.#drag?.kind === "draw" && this.#drag.box && this.#drag.id === null)
      this.#paintDrawn(context, this.#drag.box);
    else if (chosen && !this.#drag && this.#drawn() !== null) this.#paintHint(context, chosen);
  }

  boxOf(object) {
    const frame = this.#frames.shown;
    if (this.#drag?.box && this.#drag.id === object.id) return this.#drag.box;
    if (this.#sent?.id === object.id && this.#sent.frame === frame) return this.#sent.box;
    return frame === null ? null : this.#model.box(object, frame);
  }

  #paintObject(context, object, chosen) {
    const box = this.boxOf(object);
    if (!box) return;
    const state = this.#model.state(object, this.#frames.shown);
    const [x, y, w, h] = this.#onPage(box);
    const moving = this.#drag?.box && this.#drag.id === object.id;
    const bad = moving && this.#wrong(box);
    context.lineJoin = "round";
    context.setLineDash(state.kind === "lost" && !moving ? [6, 5] : []);
    context.strokeStyle = "rgb(0 0 0 / 55%)";
    context.lineWidth = chosen ? 5 : 4;
    context.strokeRect(x, y, w, h);
    context.strokeStyle = bad ? colourOf("--low") : object.colour;
    context.lineWidth = chosen ? 2.5 : 2;
    context.strokeRect(x, y, w, h);
    context.setLineDash([]);
    if (chosen) {
      context.fillStyle = `${object.colour}14`;
      context.fillRect(x, y, w, h);
    }
    this.#paintLabel(context, object, state, x, y, chosen);
    if (chosen) this.#paintHandles(context, object, [x, y, w, h]);
  }

  #paintLabel(context, object, state, x, y, chosen) {
    const key = state.kind === "keyframe";
    const text = key ? object.name : `${object.name}  ${state.text}`;
    context.font = `${chosen ? 600 : 500} 12px system-ui, sans-serif`;
    context.textBaseline = "middle";
    const width = context.measureText(text).width + 14 + (key ? 14 : 0);
    const top = y - 24 < 2 ? y + 5 : y - 25;
    const left = Math.max(2, Math.min(x - 1, this.#canvas.clientWidth - width - 2));
    context.globalAlpha = chosen ? 1 : 0.85;
    context.fillStyle = object.colour;
    context.beginPath();
    context.roundRect(left, top, width, 20, 5);
    context.fill();
    context.fillStyle = inkOn(object.colour);
    if (key) diamond(context, left + 11, top + 10, 4.5);
    if (key) context.fill();
    context.fillText(text, left + 7 + (key ? 13 : 0), top + 10.5);
    context.globalAlpha = 1;
  }

  #paintHandles(context, object, [x, y, w, h]) {
    const small = Math.min(w, h) < 34;
    HANDLES.forEach(([u, v], n) => {
      if (small && n % 2) return;
      context.beginPath();
      context.roundRect(x + u * w - 4.5, y + v * h - 4.5, 9, 9, 2);
      context.fillStyle = "#fff";
      context.fill();
      context.strokeStyle = object.colour;
      context.lineWidth = 2;
      context.stroke();
    });
  }

  #paintDrawn(context, box) {
    const [x, y, w, h] = this.#onPage(box);
    const bad = this.#wrong(box);
    context.setLineDash([6, 4]);
    context.lineWidth = 4;
    context.strokeStyle = "rgb(0 0 0 / 55%)";
    context.strokeRect(x, y, w, h);
    context.lineWidth = 2;
    context.strokeStyle = bad ? colourOf("--low") : "#fff";
    context.strokeRect(x, y, w, h);
    context.setLineDash([]);
    context.font = "500 12px system-ui, sans-serif";
    const text = bad ?? `${Math.round(box[2])} × ${Math.round(box[3])}`;
    context.textBaseline = "top";
    const width = context.measureText(text).width;
    const left = Math.max(2, Math.min(x + w + 8, this.#canvas.clientWidth - width - 12));
    context.fillStyle = bad ? colourOf("--low") : "rgb(0 0 0 / 70%)";
    context.beginPath();
    context.roundRect(left, y + h + 6, width + 12, 20, 5);
    context.fill();
    context.fillStyle = "#fff";
    context.fillText(text, left + 6, y + h + 10);
  }

  // What a drag does, where that is not a new object.
  #paintHint(context, object) {
    const text = `Drag where ${object.name} is.   N: a new object`;
    context.font = "500 12px system-ui, sans-serif";
    context.textBaseline = "middle";
    const width = context.measureText(text).width + 34;
    const left = this.#canvas.clientWidth / 2 - width / 2;
    context.fillStyle = "rgb(15 18 24 / 82%)";
    context.beginPath();
    context.roundRect(left, 10, width, 26, 8);
    context.fill();
    context.fillStyle = object.colour;
    context.beginPath();
    context.roundRect(left + 9, 18, 10, 10, 3);
    context.fill();
    context.fillStyle = "#fff";
    context.fillText(text, left + 26, 23.5);
  }

  #wrong([x, y, w, h]) {
    const { clip } = this.#model;
    if (w < SMALLEST || h < SMALLEST) return `at least ${SMALLEST} × ${SMALLEST} pixels`;
    if (x >= clip.width || y >= clip.height || x + w <= 0 || y + h <= 0) return "outside the frame";
    return null;
  }

  #onPage([x, y, w, h]) {
    const s = this.#scale;
    return [this.#x + s * x, this.#y + s * y, s * w, s * h];
  }

  #inFrame(event) {
    const { left, top } = this.#canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - left, event.clientY - top];
    return [(x - this.#x) / this.#scale, (y - this.#y) / this.#scale, x, y];
  }

  // ---- what is done

  startNew() {
    this.#start("new", "Drag a box around the new object, or press Enter for one in the middle.");
  }

  startAgain() {
    const name = this.#model.chosen?.name;
    if (name) this.#start("again", `Drag a box around ${name}, or press Enter for one in the middle.`);
  }

  #start(mode, text) {
    this.#mode = this.#mode === mode ? null : mode;
    this.#setCursor("crosshair");
    if (this.#mode) this.#model.say(text);
    this.draw();
  }

  // The object that a drag draws: the chosen one if it has no box here; null for a new one.
  #drawn(event) {
    const chosen = this.#model.chosen;
    if (!chosen || this.#mode === "new") return null;
    const again = this.#mode === "again" || event?.shiftKey || !this.boxOf(chosen);
    return again ? chosen.id : null;
  }

  // A box in the middle of what is seen, for who has only a keyboard.
  placeNew() {
    if (!this.#mode) return;
    const id = this.#drawn();
    this.#mode = null;
    const { clip } = this.#model;
    const side = Math.max(SMALLEST, Math.round(Math.min(clip.width, clip.height) / 6));
    const x = (this.#canvas.clientWidth / 2 - this.#x) / this.#scale - side / 2;
    const y = (this.#canvas.clientHeight / 2 - this.#y) / this.#scale - side / 2;
    this.#send(id, [x, y, side, side].map(Math.round));
    this.draw();
  }

  stop() {
    const busy = this.#mode || this.#drag;
    this.#mode = null;
    this.#drag = null;
    this.draw();
    return Boolean(busy);
  }

  #timer = null;

  // Moves and grows the chosen box by pixels; it is sent when the keys rest.
  nudge(dx, dy, dw, dh) {
    const object = this.#model.chosen;
    const box = object && this.boxOf(object);
    if (!box) return;
    const moved = [box[0] + dx, box[1] + dy, Math.max(SMALLEST, box[2] + dw), Math.max(SMALLEST, box[3] + dh)];
    this.#sent = { id: object.id, frame: this.#frames.shown, box: moved };
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#send(object.id, moved), 300);
    this.draw();
  }

  #send(id, box) {
    const frame = this.#frames.shown;
    const wrong = this.#wrong(box);
    if (wrong) {
      this.#sent = null;
      this.#model.say(`This box is refused: it must be at least ${SMALLEST} pixels wide and high, and in the frame.`);
      this.draw();
      return;
    }
    const rounded = box.map((value) => Math.round(value * 100) / 100);
    if (id === null) this.#model.ask("add", { frame, box: rounded });
    else {
      this.#sent = { id, frame, box };
      this.#model.ask("set", { id, frame, box: rounded });
    }
  }

  // What is under a point: a handle of the chosen box, or a box.
  #under(px, py, touch) {
    if (this.#mode) return null;
    const reach = touch ? 20 : 8;
    const chosen = this.#model.chosen;
    const box = chosen && this.boxOf(chosen);
    if (box) {
      const [x, y, w, h] = this.#onPage(box);
      let [nearest, best] = [null, reach];
      HANDLES.forEach(([u, v], n) => {
        const distance = Math.hypot(px - x - u * w, py - y - v * h);
        if (distance <= best && (n % 2 === 0 || Math.min(w, h) >= 34)) [nearest, best] = [n, distance];
      });
      if (nearest !== null) return { object: chosen, handle: nearest };
    }
    let [found, least] = [null, Infinity];
    for (const object of this.#model.objects.values()) {
      const other = this.boxOf(object);
      if (!other) continue;
      const [x, y, w, h] = this.#onPage(other);
      const inside = px >= x - 2 && py >= y - 2 && px <= x + w + 2 && py <= y + h + 2;
      const size = object === chosen ? 0 : w * h;
      if (inside && size < least) [found, least] = [object, size];
    }
    return found && { object: found, handle: null };
  }

  #down(event) {
    if (!this.#model.clip || this.#frames.shown === null) return;
    this.#canvas.setPointerCapture(event.pointerId);
    const [fx, fy, px, py] = this.#inFrame(event);
    this.#pointers.set(event.pointerId, [px, py]);
    if (this.#pointers.size === 2) {
      this.#drag = { kind: "pinch", before: this.#pinch() };
      return;
    }
    if (this.#pointers.size > 2) return;
    if (event.button === 1 || event.button === 2) {
      this.#drag = { kind: "pan", px, py };
      this.#setCursor("grabbing");
      return;
    }
    if (event.button !== 0) return;
    this.#model.quiet();
    const under = event.shiftKey ? null : this.#under(px, py, event.pointerType === "touch");
    const start = { frame: this.#frames.shown, fx, fy, px, py, moved: false };
    if (!under) {
      this.#drag = { kind: "draw", id: this.#drawn(event), box: null, ...start };
      return;
    }
    this.#model.select(under.object.id);
    const kind = under.handle === null ? "move" : "resize";
    const before = this.boxOf(under.object);
    this.#drag = { kind, id: under.object.id, handle: under.handle, before, box: null, ...start };
  }

  #move(event) {
    const [fx, fy, px, py] = this.#inFrame(event);
    if (this.#pointers.has(event.pointerId)) this.#pointers.set(event.pointerId, [px, py]);
    const drag = this.#drag;
    if (!drag) {
      if (event.pointerType !== "touch") this.#setHover(this.#under(px, py, false));
      return;
    }
    if (drag.kind === "pinch") {
      const now = this.#pinch();
      if (!now) return;
      this.#x += now.x - drag.before.x;
      this.#y += now.y - drag.before.y;
      this.zoom(now.distance / drag.before.distance, now.x, now.y);
      drag.before = now;
      return;
    }
    if (drag.kind === "pan") {
      this.#x += px - drag.px;
      this.#y += py - drag.py;
      [drag.px, drag.py] = [px, py];
      this.#fitted = false;
      this.#keepInSight();
      this.draw();
      return;
    }
    drag.moved ||= Math.hypot(px - drag.px, py - drag.py) >= 3;
    if (!drag.moved) return;
    const [dx, dy] = [fx - drag.fx, fy - drag.fy];
    if (drag.kind === "draw") {
      drag.box = this.#clamped([Math.min(fx, drag.fx), Math.min(fy, drag.fy), Math.abs(dx), Math.abs(dy)]);
    } else if (drag.kind === "move") {
      const [x, y, w, h] = drag.before;
      drag.box = [x + dx, y + dy, w, h];
    } else {
      drag.box = resized(drag.before, HANDLES[drag.handle], dx, dy);
    }
    this.draw();
  }

  #up(event) {
    if (this.#drag?.kind !== "pinch") this.#move(event);
    this.#pointers.delete(event.pointerId);
    const drag = this.#drag;
    if (!drag || (drag.kind === "pinch" && this.#pointers.size)) return;
    this.#drag = null;
    if (drag.box) {
      this.#mode = null;
      this.#send(drag.id, drag.box);
    } else if (drag.kind === "draw") this.#model.select(null);
    this.#setCursor("crosshair");
    this.draw();
  }

  #cancel(event) {
    this.#pointers.delete(event.pointerId);
    this.#drag = null;
    this.draw();
  }

  // A box that is drawn ends with the frame.
  #clamped([x, y, w, h]) {
    const { width, height } = this.#model.clip;
    const [left, top] = [Math.max(0, x), Math.max(0, y)];
    const [right, bottom] = [Math.min(width, x + w), Math.min(height, y + h)];
    return right <= left || bottom <= top ? [x, y, w, h] : [left, top, right - left, bottom - top];
  }

  #pinch() {
    const [[ax, ay], [bx, by]] = [...this.#pointers.values(), [0, 0], [0, 0]];
    if (this.#pointers.size < 2) return null;
    return { x: (ax + bx) / 2, y: (ay + by) / 2, distance: Math.max(10, Math.hypot(ax - bx, ay - by)) };
  }

  #wheel(event) {
    event.preventDefault();
    if (!this.#model.clip) return;
    const [, , px, py] = this.#inFrame(event);
    const step = event.deltaMode === 1 ? 16 * event.deltaY : event.deltaY;
    this.zoom(Math.exp(-step * (event.ctrlKey ? 0.01 : 0.0015)), px, py);
  }

  #setHover(under) {
    if (under && under.handle !== null) this.#setCursor(`${CURSORS[under.handle]}-resize`);
    else this.#setCursor(under ? "move" : "crosshair");
  }

  #setCursor(cursor) {
    this.#canvas.style.cursor = cursor;
  }
}

function resized([x, y, w, h], [u, v], dx, dy) {
  let [left, top, right, bottom] = [x, y, x + w, y + h];
  if (u === 0) left += dx;
  if (u === 1) right += dx;
  if (v === 0) top += dy;
  if (v === 1) bottom += dy;
  // A side that is dragged beyond the other takes its place.
  if (right < left) [left, right] = [right, left];
  if (bottom < top) [top, bottom] = [bottom, top];
  return [left, top, right - left, bottom - top];
}

// Black or white, what can be read on a colour #rrggbb.
export function inkOn(colour) {
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
  return 0.299 * r + 0.587 * g + 0.114 * b > 150 ? "#111" : "#fff";
}

export function diamond(context, x, y, radius) {
  context.beginPath();
  context.moveTo(x, y - radius);
  context.lineTo(x + radius, y);
  context.lineTo(x, y + radius);
  context.lineTo(x - radius, y);
  context.closePath();
}
