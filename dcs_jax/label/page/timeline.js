// The clip from left to right: one lane an object, and the place.

import { DOUBTFUL } from "./model.js";
import { colourOf, diamond } from "./view.js";

const LANE = 26;
const NAMES = 112; // pixels for the names at the left
const RAMP = ["--low", "--mid", "--high"];

export class Timeline {
  #model;
  #ruler = document.querySelector("#ruler");
  #lanes = document.querySelector("#lanes");
  #from = 0; // the frames that are seen
  #to = 1;
  #waiting = false;

  constructor(model) {
    this.#model = model;
    new ResizeObserver(() => this.draw()).observe(this.#ruler);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    model.addEventListener("change", ({ detail }) => {
      if (detail === "clip") [this.#from, this.#to] = [0, model.clip.length];
      if (detail === "frame") this.#follow();
      this.draw();
    });
    for (const canvas of [this.#ruler, this.#lanes]) {
      canvas.addEventListener("pointerdown", (event) => this.#down(event, canvas));
      canvas.addEventListener("pointermove", (event) => this.#move(event, canvas));
      canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    }
  }

  #x(frame) {
    const width = this.#ruler.clientWidth - NAMES - 12;
    return NAMES + ((frame - this.#from) / (this.#to - this.#from)) * width;
  }

  #frameAt(event) {
    const width = this.#ruler.clientWidth - NAMES - 12;
    const x = event.clientX - this.#ruler.getBoundingClientRect().left - NAMES;
    return Math.floor(this.#from + (x / width) * (this.#to - this.#from));
  }

  #down(event, canvas) {
    if (!this.#model.clip || event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    if (canvas === this.#lanes) {
      const row = Math.floor(event.offsetY / LANE);
      const object = [...this.#model.objects.values()][row];
      if (object) this.#model.select(object.id);
      if (event.offsetX < NAMES) return;
    }
    this.#model.go(this.#frameAt(event));
  }

  #move(event, canvas) {
    if (canvas.hasPointerCapture(event.pointerId) && (canvas === this.#ruler || event.offsetX > NAMES))
      this.#model.go(this.#frameAt(event));
  }

  #wheel(event) {
    const { clip } = this.#model;
    if (!clip || !(event.ctrlKey || event.shiftKey)) return;
    event.preventDefault();
    const span = this.#to - this.#from;
    let at = this.#frameAt(event);
    let wanted = span;
    if (event.ctrlKey) wanted = Math.max(20, Math.min(clip.length, span * Math.exp(event.deltaY * 0.003)));
    else at += ((event.deltaX || event.deltaY) / this.#ruler.clientWidth) * span;
    const from = event.ctrlKey ? at - ((at - this.#from) * wanted) / span : this.#from + at - this.#frameAt(event);
    this.#from = Math.max(0, Math.min(clip.length - wanted, from));
    this.#to = this.#from + Math.min(wanted, clip.length);
    this.draw();
  }

  #follow() {
    const { frame, clip } = this.#model;
    const span = this.#to - this.#from;
    if (frame >= this.#from && frame < this.#to) return;
    this.#from = Math.max(0, Math.min(clip.length - span, frame - span / 2));
    this.#to = this.#from + span;
  }

  draw() {
    if (this.#waiting) return;
    this.#waiting = true;
    requestAnimationFrame(() => {
      this.#waiting = false;
      if (!this.#model.clip) return;
      this.#paintRuler();
      this.#paintLanes();
    });
  }

  #begin(canvas, height) {
    const [width, ratio] = [canvas.clientWidth, devicePixelRatio];
    canvas.style.height = `${height}px`;
    if (canvas.width !== width * ratio) canvas.width = width * ratio;
    if (canvas.height !== height * ratio) canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return context;
  }

  #paintRuler() {
    const context = this.#begin(this.#ruler, 24);
    const [text, dim, line] = ["--text", "--dim", "--line"].map(colourOf);
    const width = this.#ruler.clientWidth;
    const every = (this.#to - this.#from) / Math.max(2, Math.floor((width - NAMES) / 80));
    const power = 10 ** Math.floor(Math.log10(Math.max(every, 1)));
    const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= every);
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "middle";
    const place = this.#x(this.#model.frame + 0.5);
    for (let frame = Math.ceil(this.#from / step) * step; frame < this.#to; frame += step) {
      const x = this.#x(frame + 0.5);
      context.fillStyle = line;
      context.fillRect(x, 17, 1, 7);
      context.fillStyle = dim;
      if (x < width - 40 && Math.abs(x + 12 - place) > 28) context.fillText(frame, x + 4, 12);
    }
    const x = place;
    const label = String(this.#model.frame);
    context.font = "600 11px system-ui, sans-serif";
    const wide = context.measureText(label).width + 12;
    const left = Math.max(0, Math.min(x - wide / 2, width - wide));
    context.fillStyle = text;
    context.beginPath();
    context.roundRect(left, 3, wide, 17, 5);
    context.fill();
    context.fillRect(x - 0.75, 19, 1.5, 5);
    context.fillStyle = colourOf("--panel");
    context.fillText(label, left + 6, 12);
  }

  #paintLanes() {
    const objects = [...this.#model.objects.values()];
    const height = Math.max(objects.length * LANE, this.#lanes.parentElement.clientHeight - 1);
    const context = this.#begin(this.#lanes, height);
    const colours = { ramp: ramp(), void: colourOf("--void"), text: colourOf("--text"), dim: colourOf("--dim") };
    colours.hatch = hatch(context, colourOf("--hatch"), colours.void);
    colours.doubt = colourOf("--low");
    colours.panel = colourOf("--panel");
    colours.line = colourOf("--hatch");
    objects.forEach((object, row) => this.#paintLane(context, object, row, colours));
    const x = this.#x(this.#model.frame + 0.5);
    context.fillStyle = colours.text;
    context.fillRect(x - 0.75, 0, 1.5, height);
  }

  #paintLane(context, object, row, colours) {
    const top = row * LANE;
    const chosen = object.id === this.#model.selected;
    const width = this.#lanes.clientWidth;
    if (chosen) {
      context.fillStyle = colourOf("--hover");
      context.fillRect(0, top, width, LANE);
    }
    context.fillStyle = object.colour;
    context.beginPath();
    context.roundRect(12, top + 8, 10, 10, 3);
    context.fill();
    context.fillStyle = chosen ? colours.text : colours.dim;
    context.font = `${chosen ? 600 : 400} 12px system-ui, sans-serif`;
    context.textBaseline = "middle";
    context.save();
    context.beginPath();
    context.rect(0, top, NAMES - 8, LANE);
    context.clip();
    context.fillText(object.name, 28, top + 13.5);
    context.restore();
    const [left, right] = [this.#x(this.#from), this.#x(this.#to)];
    context.save();
    context.beginPath();
    context.roundRect(left, top + 6, right - left, 14, 4);
    context.clip();
    context.fillStyle = colours.void;
    context.fillRect(left, top + 6, right - left, 14);
    this.#paintFrames(context, object, top, colours);
    context.restore();
    for (const [frame, box] of object.keyframes) {
      if (frame < this.#from || frame >= this.#to) continue;
      diamond(context, this.#x(frame + 0.5), top + 13, 6.5);
      context.fillStyle = box ? object.colour : colours.panel;
      context.fill();
      context.strokeStyle = box ? "#fff" : object.colour;
      context.lineWidth = box ? 1.5 : 2;
      context.stroke();
    }
  }

  // Column by column, the worst of the frames that fall into it.
  #paintFrames(context, object, top, colours) {
    const [first, last] = [Math.floor(this.#from), Math.min(Math.ceil(this.#to), this.#model.clip.length)];
    const perPixel = (this.#to - this.#from) / (this.#x(this.#to) - this.#x(this.#from));
    const step = Math.max(1, Math.floor(perPixel));
    for (let start = first; start < last; start += step) {
      let [worst, lost, known, doubt] = [Infinity, false, false, 0];
      for (let frame = start; frame < Math.min(start + step, last); frame++) {
        lost ||= object.lost[frame] === 1;
        doubt = Math.max(doubt, object.doubt[frame]);
        if (Number.isNaN(object.boxes[4 * frame])) continue;
        known = true;
        const confidence = object.confidence[frame];
        worst = Math.min(worst, Number.isNaN(confidence) ? 1 : confidence);
      }
      const [x, end] = [start, Math.min(start + step, last)].map(
        (at) => Math.round(devicePixelRatio * this.#x(at)) / devicePixelRatio,
      );
      if (!known && lost) {
        // Not here: a gap with a thin line.
        context.fillStyle = colours.panel;
        context.fillRect(x, top + 6, end - x, 14);
        context.fillStyle = colours.line;
        context.fillRect(x, top + 12, end - x, 2);
      }
      if (!known) continue;
      context.fillStyle = lost ? colours.hatch : colours.ramp[Math.round(20 * Math.max(0, Math.min(1, worst)))];
      context.fillRect(x, top + 6, end - x, 14);
      if (doubt > DOUBTFUL && !lost) {
        context.fillStyle = colours.doubt;
        context.fillRect(x, top + 17, end - x, 3);
      }
    }
  }
}

// 21 colours from no confidence to the full one.
function ramp() {
  const stops = RAMP.map((name) => colourOf(name).trim()).map((colour) =>
    [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16)),
  );
  return Array.from({ length: 21 }, (_, n) => {
    const place = n / 10;
    const low = Math.min(1, Math.floor(place));
    const mixed = stops[low].map((value, channel) => value + (stops[low + 1][channel] - value) * (place - low));
    return `rgb(${mixed.map(Math.round).join(" ")})`;
  });
}

function hatch(context, line, ground) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 12;
  const small = tile.getContext("2d");
  small.fillStyle = ground;
  small.fillRect(0, 0, 12, 12);
  small.strokeStyle = line;
  small.lineWidth = 2;
  for (const at of [-6, 0, 6, 12, 18]) {
    small.beginPath();
    small.moveTo(at - 2, 14);
    small.lineTo(at + 14, -2);
    small.stroke();
  }
  const pattern = context.createPattern(tile, "repeat");
  pattern.setTransform(new DOMMatrix().scale(0.8));
  return pattern;
}
