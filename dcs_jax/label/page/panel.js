// The list of objects, what can be done with the chosen one, and what the server is doing.

import { DOUBTFUL } from "./model.js";
import { inkOn } from "./view.js";

const $ = (selector) => document.querySelector(selector);

export class Panel {
  #model;
  #frames;
  #renaming = null; // id of the object whose name is written
  #messageTimer = null;

  constructor(model, frames) {
    this.#model = model;
    this.#frames = frames;
    model.addEventListener("change", ({ detail }) => {
      if (["objects", "clip", "selected"].includes(detail)) this.#list();
      if (["rows", "frame"].includes(detail)) this.#states();
      if (detail === "status" || detail === "objects") this.#status();
      if (detail === "objects") this.#history();
      if (detail === "saved") this.#saved();
      if (detail === "clip") this.#clip();
      if (detail === "frame" || detail === "clip") this.#place();
    });
    model.addEventListener("say", ({ detail }) => this.say(detail));
    model.addEventListener("quiet", () => this.quiet());
    frames.addEventListener("shown", () => this.#states());
    $("#frame").addEventListener("change", (event) => {
      const wanted = Number(event.target.value);
      if (event.target.value.trim() !== "" && Number.isInteger(wanted)) model.go(wanted);
      event.target.blur();
      this.#place();
    });
    for (const [id, type] of [["#undo", "undo"], ["#redo", "redo"]])
      $(id).addEventListener("click", () => model.ask(type));
  }

  #history() {
    $("#undo").disabled = !this.#model.canUndo;
    $("#redo").disabled = !this.#model.canRedo;
  }

  say(text) {
    const message = $("#message");
    message.textContent = text;
    message.hidden = false;
    clearTimeout(this.#messageTimer);
    this.#messageTimer = setTimeout(() => (message.hidden = true), 3000 + 60 * text.length);
  }

  quiet() {
    $("#message").hidden = true;
  }

  rename(id) {
    if (id === null) return;
    this.#renaming = id;
    this.#list();
    const input = $("#objects input");
    input?.focus();
    input?.select();
  }

  #clip() {
    const { name, width, height, length, fps } = this.#model.clip;
    document.title = `${name} – dcs-jax label`;
    $("#clip-name").textContent = name;
    $("#clip-name").title = name;
    $("#clip-facts").textContent = `${width} × ${height}, ${Number(fps.toFixed(2))} fps`;
    $("#frame-of").textContent = `of ${length - 1}`;
    this.#place();
  }

  #place() {
    const { clip, frame } = this.#model;
    const field = $("#frame");
    if (document.activeElement !== field) field.value = frame;
    const seconds = frame / clip.fps;
    $("#time").textContent = `${Math.floor(seconds / 60)}:${(seconds % 60).toFixed(2).padStart(5, "0")}`;
  }

  #list() {
    const { objects, selected } = this.#model;
    const list = $("#objects");
    if (this.#renaming !== null && !objects.has(this.#renaming)) this.#renaming = null;
    const written = this.#renaming === null ? null : list.querySelector("input");
    const rows = [...objects.values()].map((object, n) => this.#row(object, n, object.id === selected, written));
    list.replaceChildren(...rows);
    if (written) written.focus();
    list.querySelector('[aria-selected="true"]')?.scrollIntoView({ block: "nearest" });
    $("#hint").hidden = objects.size > 0 || !this.#model.clip;
    this.#states();
  }

  #row(object, n, chosen, written) {
    const row = document.createElement("li");
    row.dataset.id = object.id;
    row.setAttribute("aria-selected", chosen);
    const digit = document.createElement("span");
    digit.className = "digit";
    digit.style.background = object.colour;
    digit.style.color = inkOn(object.colour);
    digit.textContent = n < 9 ? n + 1 : "";
    const name = document.createElement("span");
    name.className = "name";
    name.title = `${object.name}: double-click to rename (R)`;
    if (this.#renaming === object.id) name.append(written ?? this.#field(object));
    else name.textContent = object.name;
    const state = document.createElement("span");
    state.className = "state";
    row.append(digit, name, state);
    row.addEventListener("click", () => this.#model.select(object.id));
    row.addEventListener("dblclick", () => this.rename(object.id));
    return row;
  }

  #field(object) {
    const input = document.createElement("input");
    input.value = object.name;
    input.maxLength = 200;
    input.setAttribute("aria-label", "Name");
    let done = false;
    const end = (keep) => {
      if (done) return;
      done = true;
      this.#renaming = null;
      const name = input.value.trim();
      if (keep && name && name !== object.name) this.#model.ask("rename", { id: object.id, name });
      this.#list();
    };
    input.addEventListener("blur", () => setTimeout(() => input.isConnected && document.activeElement !== input && end(true)));
    input.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === "Escape") end(event.key === "Enter");
      event.stopPropagation();
    });
    return input;
  }

  #states() {
    const model = this.#model;
    const frame = this.#frames.shown ?? model.frame;
    for (const row of document.querySelectorAll("#objects li")) {
      const object = model.objects.get(Number(row.dataset.id));
      if (!object) continue;
      const { kind, text } = model.state(object, frame);
      const state = row.querySelector(".state");
      state.textContent = text;
      state.classList.toggle("bad", kind === "lost" || (kind === "tracked" && object.doubt[frame] > DOUBTFUL));
    }
    const object = model.chosen;
    $("#actions").hidden = !object;
    $("#doubtful").disabled = model.objects.size === 0;
    if (!object) return;
    const state = model.state(object, frame);
    const box = model.box(object, frame);
    $("#here-name").textContent = object.name;
    $("#here-state").textContent = box ? box.map((value) => Math.round(value)).join(", ") : state.text;
    $("#keep").disabled = !box || state.kind === "keyframe";
    $("#absent").disabled = object.keyframes.get(frame) === null;
    $("#unkey").disabled = !object.keyframes.has(frame) || object.keyframes.size < 2;
  }

  #status() {
    const { state, done, total, rate } = this.#model.status;
    const running = state === "tracking";
    const speed = rate ? `, ${Math.round(rate)} frames/s` : "";
    const waiting = this.#model.status.waiting > 0;
    const texts = {
      connecting: "connecting …",
      gone: "the server has ended",
      compiling: waiting ? "compiling, then it is tracked …" : "compiling …",
      tracking: `tracking ${total ? Math.floor((100 * done) / total) : 0} %${speed}`,
      stopped: "tracking is stopped",
      idle: this.#model.objects.size ? "all tracked" : "",
    };
    $("#status-text").textContent = texts[state];
    $("#status").dataset.state = state;
    $("#progress").hidden = !running;
    $("#progress").value = total ? done / total : 0;
    $("#pause").hidden = !(running || state === "stopped");
    $("#pause").textContent = running ? "Stop" : "Track";
  }

  #saved() {
    const { what, problem } = this.#model.saved;
    const saved = $("#saved");
    saved.dataset.state = problem ? "problem" : what;
    const texts = { all: "saved", edits: "edits saved", no: "saving …" };
    saved.textContent = problem ? "not saved" : texts[what];
    saved.title = problem ?? `Kept in ${this.#model.clip?.project ?? "the project"}`;
    if (problem) this.say(problem);
  }
}
