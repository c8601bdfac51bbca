// What is pressed and clicked, by name: the keys, the buttons and the list of keys are made of it.

import { exportDialog, keysDialog } from "./dialogs.js";
import { Frames } from "./frames.js";
import { Model } from "./model.js";
import { Panel } from "./panel.js";
import { Timeline } from "./timeline.js";
import { View } from "./view.js";

const $ = (selector) => document.querySelector(selector);
const model = new Model();
const frames = new Frames(model);
const view = new View(model, frames);
const panel = new Panel(model, frames);
new Timeline(model);

const player = { on: false, due: 0 };

function play(on = !player.on) {
  if (!model.clip) return;
  if (on && model.frame === model.clip.length - 1) model.go(0);
  player.on = on;
  player.due = performance.now();
  $("#play").classList.toggle("playing", on);
  $("#play").setAttribute("aria-label", on ? "Pause" : "Play");
  if (on) requestAnimationFrame(tick);
}

// No frame is left out: where they do not come fast enough, it plays slower.
function tick(now) {
  if (!player.on) return;
  const ready = frames.shown === model.frame && frames.has(model.frame + 1);
  if (ready && now >= player.due) {
    player.due = Math.max(player.due + 1000 / model.clip.fps, now - 50);
    model.go(model.frame + 1);
  }
  if (model.frame === model.clip.length - 1) play(false);
  else requestAnimationFrame(tick);
}

const go = (frame) => {
  play(false);
  model.go(frame);
};
const step = (count) => () => go(model.frame + count);
const here = () => frames.shown ?? model.frame;

function keyframe(direction) {
  const known = [...(model.chosen?.keyframes.keys() ?? [])].sort((a, b) => direction * (a - b));
  const next = known.find((frame) => direction * (frame - model.frame) > 0);
  if (next !== undefined) go(next);
}

function choose(direction) {
  const ids = [...model.objects.keys()];
  if (!ids.length) return;
  const at = ids.indexOf(model.selected);
  model.select(ids[(at + direction + ids.length) % ids.length]);
}

function withChosen(act) {
  return () => {
    if (model.chosen) act(model.chosen);
    else model.say("Choose an object first.");
  };
}

const keep = withChosen((object) => {
  const box = model.box(object, here());
  if (box) model.ask("set", { id: object.id, frame: here(), box });
  else model.say(`${object.name} has no box in this frame: draw one, with N and a drag.`);
});
const absent = withChosen(({ id }) => model.ask("set", { id, frame: here(), box: null }));
const unkey = withChosen(({ id }) => model.ask("remove", { id, frame: here() }));
const erase = withChosen(({ id }) => model.ask("delete", { id }));
const doubtful = () => {
  play(false);
  model.ask("doubtful", { frame: model.frame, id: null });
};
const pause = () => model.ask(model.status.state === "stopped" ? "resume" : "pause");
const openExports = () => exportDialog(model);
const openKeys = () => keysDialog(KEYS);

function escape() {
  panel.quiet();
  if (!view.stop()) model.select(null);
}

function nudge(x, y) {
  return (event) => {
    const by = event.shiftKey ? 10 : 1;
    if (event.altKey) view.nudge(by * x, by * y, 0, 0);
    else view.nudge(0, 0, by * x, by * y);
  };
}

// Keys as they are shown, those of events, what is done, and whether with Ctrl or Alt.
const KEYS = [
  ["Space", [" "], () => play(), "play, pause"],
  ["← →", ["ArrowLeft"], step(-1), "one frame back, on"],
  [null, ["ArrowRight"], step(1)],
  ["Shift ← →", ["shift+ArrowLeft"], step(-10), "ten frames back, on"],
  [null, ["shift+ArrowRight"], step(10)],
  ["Home End", ["Home"], () => go(0), "first, last frame"],
  [null, ["End"], () => go(model.clip.length - 1)],
  [", .", [","], () => keyframe(-1), "keyframe before, after"],
  [null, ["."], () => keyframe(1)],
  ["D", ["d"], doubtful, "next doubtful frame"],
  ["1 … 9", [], null, "choose an object"],
  ["↑ ↓", ["ArrowUp"], () => choose(-1), "object before, after"],
  [null, ["ArrowDown"], () => choose(1)],
  ["N", ["n"], () => view.startNew(), "draw a new object"],
  ["Enter", ["Enter"], () => view.placeNew(), "after N or B: in the middle"],
  ["Alt arrows", ["alt+ArrowLeft"], nudge(-1, 0), "move the box (Shift: by 10)"],
  [null, ["alt+ArrowRight"], nudge(1, 0)],
  [null, ["alt+ArrowUp"], nudge(0, -1)],
  [null, ["alt+ArrowDown"], nudge(0, 1)],
  ["Ctrl arrows", ["ctrl+ArrowLeft"], nudge(-1, 0), "resize the box"],
  [null, ["ctrl+ArrowRight"], nudge(1, 0)],
  [null, ["ctrl+ArrowUp"], nudge(0, -1)],
  [null, ["ctrl+ArrowDown"], nudge(0, 1)],
  ["B", ["b"], () => view.startAgain(), "draw the box again (or Shift drag)"],
  ["K", ["k"], keep, "keyframe: the box is right"],
  ["X", ["x"], absent, "not here, up to the next keyframe"],
  ["Backspace", ["Backspace"], unkey, "remove the keyframe"],
  ["Delete", ["Delete"], erase, "delete the object"],
  ["R", ["r", "F2"], () => panel.rename(model.selected), "rename"],
  ["Ctrl Z", ["ctrl+z"], () => model.ask("undo"), "undo"],
  ["Ctrl Shift Z", ["ctrl+shift+z", "ctrl+y"], () => model.ask("redo"), "redo"],
  ["S", ["s"], pause, "stop tracking, go on"],
  ["+ −", ["+", "="], () => view.zoom(1.25), "zoom (or the wheel)"],
  [null, ["-"], () => view.zoom(0.8)],
  ["F", ["f"], () => view.fit(), "fit the frame"],
  ["E", ["e"], openExports, "export"],
  ["Esc", ["Escape"], escape, "leave, choose nothing"],
  ["?", ["?"], openKeys, "these keys"],
];

const actions = new Map(KEYS.flatMap(([, names, act]) => names.map((name) => [name, act])));

function nameOf(event) {
  const letter = event.key.length === 1;
  const key = letter ? event.key.toLowerCase() : event.key;
  const shift = event.shiftKey && (!letter || event.ctrlKey || event.metaKey);
  const modifiers = [
    (event.ctrlKey || event.metaKey) && "ctrl+",
    event.altKey && "alt+",
    shift && !(event.altKey || (event.ctrlKey && !letter)) && "shift+",
  ];
  return modifiers.filter(Boolean).join("") + key;
}

addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, dialog[open]")) return;
  if (event.key === "Enter" && event.target.closest?.("button")) return; // it presses the button
  const digit = /^[1-9]$/.test(event.key) && !event.ctrlKey && !event.altKey && !event.metaKey;
  if (digit) {
    const id = [...model.objects.keys()][Number(event.key) - 1];
    if (id !== undefined) model.select(id);
    return;
  }
  const act = actions.get(nameOf(event));
  if (!act || !model.clip) return;
  event.preventDefault();
  act(event);
});

const BUTTONS = {
  "#play": () => play(), "#back": step(-1), "#forth": step(1), "#first": () => go(0),
  "#last": () => go(model.clip.length - 1), "#new": () => view.startNew(), "#again": () => view.startAgain(),
  "#rename": () => panel.rename(model.selected), "#keep": keep,
  "#absent": absent, "#unkey": unkey, "#delete": erase, "#doubtful": doubtful, "#pause": pause,
  "#export": openExports, "#help": openKeys, "#zoom-in": () => view.zoom(1.25),
  "#zoom-out": () => view.zoom(0.8), "#zoom-fit": () => view.fit(),
};
for (const [button, act] of Object.entries(BUTTONS)) $(button).addEventListener("click", act);

model.addEventListener("change", ({ detail }) => {
  if (detail === "go") play(false);
});
model.connect();
