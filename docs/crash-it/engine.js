// The compiled plant and shield (c/page/plant.c), and a game of two vehicles that fly the same commands.
"use strict";

const PERIOD = 0.01; // s
const SPEED = 2.0; // m/s, of a full command
const SHIELDED = 0, BARE = 1;
// As in c/quadsafe.h.
const KINDS = { sphere: 1, capsule: 2, cylinder: 3, box: 4, half_space: 6 };
const NO_ROTATION = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

class Engine {
  constructor() {
    const bytes = Uint8Array.from(atob(SHIELD_WASM), (letter) => letter.charCodeAt(0));
    this.c = new WebAssembly.Instance(new WebAssembly.Module(bytes)).exports;
    this.c._initialize();
    const numbers = (address, count) => new Float64Array(this.c.memory.buffer, address, count);
    this.input = numbers(this.c.input(), 16);
    this.line = numbers(this.c.line(), 3 * 128);
    this.reports = [SHIELDED, BARE].map((i) => numbers(this.c.report(i), 22));
  }

  load(scene) {
    this.scene = scene;
    this.c.clear(scene.radius);
    for (const shape of scene.shapes) {
      this.input.set(numbersOf(shape));
      if (!this.c.add(KINDS[shape.shape])) throw new Error(`no shape for the shield: ${JSON.stringify(shape)}`);
    }
  }

  step(i, command, isShielded) {
    return this.c.step(i, ...command, isShielded) === 1;
  }

  position(i) { return this.reports[i].subarray(0, 3); }
  velocity(i) { return this.reports[i].subarray(3, 6); }
  acceleration(i) { return this.reports[i].subarray(6, 9); }
  wanted(i) { return this.reports[i].subarray(12, 15); }
  snap(i) { return this.reports[i].subarray(15, 18); }
  correction(i) { return this.reports[i][18]; }
  clearance(i) { return this.reports[i][19]; }
  isCertified(i) { return this.reports[i][21] === 1; }
}

function numbersOf({ shape, center, start, end, radius, size, rotation = NO_ROTATION, normal, offset }) {
  if (shape === "sphere") return [...center, radius];
  if (shape === "box") return [...center, ...size, ...rotation.flat()];
  if (shape === "half_space") return [...normal, offset];
  return [...start, ...end, radius];
}

class Game {
  constructor(engine) {
    this.engine = engine;
    this.crashes = { with: 0, without: 0 };
    this.isOn = true;
    this.told = "";
    this.open(0);
  }

  open(number) {
    this.number = (number + SCENES.length) % SCENES.length;
    this.engine.load(SCENES[this.number]);
    this.restart();
  }

  restart() {
    this.waits = 0; // periods for which the bare vehicle lies where it crashed
    this.isEngaged = false; // whether the shield has known a stop since it began
    for (const i of [SHIELDED, BARE]) this.engine.c.place(i, ...this.engine.scene.start);
  }

  // The one that the pilot sees as his own.
  get own() { return this.isOn ? SHIELDED : BARE; }
  get isBareFlying() { return this.waits === 0; }

  toggle() {
    this.isOn = !this.isOn;
    if (!this.isOn) this.waits = 0;
    if (this.waits > 0) this.restart();
    this.engine.c.join(this.own, 1 - this.own);
    this.engine.c.forget(this.own);
    this.isEngaged = false;
  }

  fly(command) {
    if (this.isOn) this.flyShielded(command);
    this.flyBare(command);
  }

  flyShielded(command) {
    const isCrashed = this.engine.step(SHIELDED, command, true);
    this.isEngaged ||= this.engine.isCertified(SHIELDED);
    if (!isCrashed) return;
    // Put in front of a wall at full speed, a shield has never known a stop.
    this.count(this.isEngaged ? "with" : "without");
    this.restart();
  }

  flyBare(command) {
    if (this.waits > 0) {
      this.waits -= 1;
      if (this.waits > 0) return;
      if (this.isOn) this.engine.c.join(BARE, SHIELDED);
      else this.restart();
    } else if (this.engine.step(BARE, command, false)) {
      this.count("without");
      this.waits = 100;
    }
  }

  count(which) {
    this.crashes[which] += 1;
    this.told = which === "with" ? "Crashed with the shield." : "Crashed without the shield.";
  }
}
