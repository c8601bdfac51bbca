// The frames as images: the one that is wanted first, then those that come next.

const BYTES = 300e6;
const AHEAD = 10;
const BEHIND = 3;
const AT_ONCE = 3;

export class Frames extends EventTarget {
  #model;
  #kept = new Map(); // from index to an image, or to the text that says why there is none
  #coming = new Set();
  #step = 1;
  #small = null; // the preview of a frame that is on its way
  shown = null; // index of the frame that can be seen, whose boxes belong on it

  constructor(model) {
    super();
    this.#model = model;
    model.addEventListener("change", ({ detail }) => {
      if (detail === "clip" || detail === "frame") this.#want();
    });
  }

  get image() {
    const kept = this.#kept.get(this.shown);
    if (kept === undefined && this.#small?.index === this.shown) return this.#small.image;
    return kept instanceof ImageBitmap ? kept : null;
  }

  has(index) {
    return this.#kept.has(index);
  }

  #most() {
    const { width, height } = this.#model.clip;
    return Math.max(AHEAD + BEHIND + 2, Math.min(200, Math.floor(BYTES / (4 * width * height))));
  }

  #want() {
    const wanted = this.#model.frame;
    if (this.shown !== null && wanted !== this.shown) this.#step = wanted > this.shown ? 1 : -1;
    if (this.#kept.has(wanted)) this.#show(wanted);
    this.#load();
  }

  #show(index) {
    if (this.shown === index) return;
    this.shown = index;
    const kept = this.#kept.get(index);
    if (typeof kept === "string") this.#model.say(kept);
    this.dispatchEvent(new Event("shown"));
  }

  #load() {
    const place = this.#model.frame;
    const order = [place];
    for (let n = 1; n <= AHEAD; n++) order.push(place + n * this.#step);
    for (let n = 1; n <= BEHIND; n++) order.push(place - n * this.#step);
    for (const index of order) {
      if (this.#coming.size >= AT_ONCE || (index !== place && this.#coming.has(place))) return;
      if (index < 0 || index >= this.#model.clip.length) continue;
      if (!this.#kept.has(index) && !this.#coming.has(index)) this.#fetch(index);
    }
  }

  // A small image of the frame until the whole one is there, which may need many to be decoded.
  async #preview(index) {
    try {
      const response = await fetch(`/preview/${index}`);
      if (response.status !== 200) return;
      const image = await createImageBitmap(await response.blob());
      if (this.#kept.has(index) || this.#model.frame !== index) return;
      this.#small = { index, image };
      this.#show(index);
    } catch {
      // The whole one is on its way.
    }
  }

  async #fetch(index) {
    this.#coming.add(index);
    if (index === this.#model.frame) this.#preview(index);
    try {
      const response = await fetch(`/frame/${index}`);
      const blob = response.ok && (await response.blob());
      this.#keep(index, blob ? await createImageBitmap(blob) : await response.text());
    } catch {
      await new Promise((done) => setTimeout(done, 1000)); // the server may come back
    }
    this.#coming.delete(index);
    // While the place moves on faster than frames come, those on the way are shown.
    const { frame } = this.#model;
    const nearer = Math.abs(index - frame) < Math.abs((this.shown ?? Infinity) - frame);
    if (this.#kept.has(index) && index === this.shown) this.dispatchEvent(new Event("shown"));
    else if (this.#kept.has(index) && (index === frame || nearer)) this.#show(index);
    this.#load();
  }

  #keep(index, image) {
    this.#kept.set(index, image);
    while (this.#kept.size > this.#most()) {
      let farthest = null;
      for (const kept of this.#kept.keys()) {
        const distance = Math.abs(kept - this.#model.frame);
        if (kept !== this.shown && (farthest === null || distance > Math.abs(farthest - this.#model.frame)))
          farthest = kept;
      }
      this.#kept.get(farthest).close?.();
      this.#kept.delete(farthest);
    }
  }
}
