// What the server has told: the clip, its objects, what is tracked and saved; and the place.

export const DOUBTFUL = 1; // a frame with more doubt is where to look, as `annotate.doubt` has it

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

function numbers(text) {
  const view = new DataView(bytes(text).buffer);
  return Float32Array.from({ length: view.byteLength / 4 }, (_, n) => view.getFloat32(4 * n, true));
}

export class Model extends EventTarget {
  clip = null;
  objects = new Map();
  canUndo = false;
  canRedo = false;
  status = { state: "connecting" };
  saved = { what: "all", problem: null };
  frame = 0;
  selected = null;
  #socket = null;
  #tries = 0;
  #begun = false;

  connect() {
    const socket = new WebSocket(`ws://${location.host}/events`);
    this.#socket = socket;
    socket.onmessage = (event) => this.#take(JSON.parse(event.data));
    socket.onopen = () => (this.#tries = 0);
    socket.onclose = () => {
      this.status = { state: "gone" };
      this.changed("status");
      setTimeout(() => this.connect(), Math.min(500 * 2 ** this.#tries++, 5000));
    };
  }

  ask(type, given = {}) {
    if (this.#socket?.readyState !== WebSocket.OPEN) {
      this.say("The server has ended: start dcs-jax label again. What was saved is still there.");
      return;
    }
    this.#socket.send(JSON.stringify({ type, ...given }));
  }

  say(text) {
    this.dispatchEvent(new CustomEvent("say", { detail: text }));
  }

  quiet() {
    this.dispatchEvent(new Event("quiet"));
  }

  changed(what) {
    this.dispatchEvent(new CustomEvent("change", { detail: what }));
  }

  go(frame) {
    if (!this.clip) return;
    const wanted = Math.max(0, Math.min(this.clip.length - 1, Math.round(frame)));
    if (wanted === this.frame) return;
    this.frame = wanted;
    this.changed("frame");
  }

  select(id) {
    if (this.selected === id) return;
    this.selected = id;
    this.changed("selected");
  }

  get chosen() {
    return this.objects.get(this.selected) ?? null;
  }

  box(object, frame) {
    const box = object.boxes.subarray(4 * frame, 4 * frame + 4);
    return Number.isNaN(box[0]) ? null : Array.from(box);
  }

  // What is known of an object in a frame: its kind, and a text for people.
  state(object, frame) {
    if (object.keyframes.has(frame)) {
      const here = object.keyframes.get(frame);
      return here ? { kind: "keyframe", text: "keyframe" } : { kind: "absent", text: "not here" };
    }
    const box = this.box(object, frame);
    if (object.lost[frame]) return { kind: box ? "lost" : "absent", text: box ? "lost" : "not here" };
    if (!box) return { kind: "unknown", text: "not tracked" };
    const confidence = object.confidence[frame];
    const text = Number.isNaN(confidence) ? "" : `${Math.round(100 * confidence)} %`;
    return { kind: "tracked", text };
  }

  #take(message) {
    const take = {
      clip: () => {
        this.clip = message;
        this.frame = Math.min(this.frame, message.length - 1);
        this.objects.clear();
        if (!this.#begun) for (const note of message.notes) this.say(note);
        this.#begun = true;
      },
      objects: () => {
        [this.canUndo, this.canRedo] = [message.can_undo, message.can_redo];
        this.#takeObjects(message.objects);
      },
      rows: () => this.#takeRows(message),
      saved: () => (this.saved = message),
      status: () => {
        if (message.problem && message.problem !== this.status.problem) this.say(message.problem);
        this.status = message;
      },
      go: () => {
        this.select(message.id);
        this.go(message.frame);
      },
      error: () => this.say(message.text),
    };
    take[message.type]();
    this.changed(message.type);
  }

  #takeObjects(objects) {
    const before = this.objects;
    this.objects = new Map();
    for (const { id, name, colour, keyframes } of objects) {
      const length = this.clip.length;
      const object = before.get(id) ?? {
        id,
        boxes: new Float32Array(4 * length).fill(NaN),
        confidence: new Float32Array(length).fill(NaN),
        doubt: new Float32Array(length),
        lost: new Uint8Array(length),
      };
      object.name = name;
      object.colour = colour;
      object.keyframes = new Map(Object.entries(keyframes).map(([at, box]) => [Number(at), box]));
      this.objects.set(id, object);
    }
    if (!this.objects.has(this.selected)) {
      this.selected = this.objects.keys().next().value ?? null;
      this.changed("selected");
    }
  }

  #takeRows({ id, start, boxes, confidence, doubt, lost }) {
    const object = this.objects.get(id);
    if (!object) return;
    object.boxes.set(numbers(boxes), 4 * start);
    object.confidence.set(numbers(confidence), start);
    object.doubt.set(numbers(doubt), start);
    object.lost.set(bytes(lost), start);
  }
}
