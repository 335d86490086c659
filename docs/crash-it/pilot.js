// What a pilot asks for by keys, thumbs and gamepad: forward, left, up and turn, each from -1 to 1.
"use strict";

const AXES = ["forward", "left", "up", "turn"];
const FLIES = {
  KeyW: ["forward", 1], KeyS: ["forward", -1], KeyA: ["left", 1], KeyD: ["left", -1],
  ArrowUp: ["up", 1], ArrowDown: ["up", -1], Space: ["up", 1], ShiftLeft: ["up", -1], ShiftRight: ["up", -1],
  ArrowLeft: ["turn", 1], ArrowRight: ["turn", -1],
};
const PRESSES = { KeyE: "shield", KeyP: "attack", KeyT: "time", KeyN: "next", KeyR: "restart", KeyH: "help", Escape: "close" };
const GAMEPAD_PRESSES = ["shield", "next"];
const DEAD_ZONE = 0.15;

class Pilot {
  constructor(press) {
    this.press = press;
    this.held = new Set();
    this.pads = { left: [0, 0], right: [0, 0] };
    this.buttons = [];
    addEventListener("keydown", (event) => this.keyDown(event));
    addEventListener("keyup", (event) => this.held.delete(event.code));
    addEventListener("blur", () => this.held.clear());
    for (const side of ["left", "right"]) this.listen(side);
  }

  keyDown(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    // A button that has the focus keeps the keys that press it.
    if (event.code === "Space" && event.target.closest("button")) return;
    if (FLIES[event.code]) {
      this.held.add(event.code);
      event.preventDefault();
    } else if (PRESSES[event.code] && !event.repeat) this.press(PRESSES[event.code]);
  }

  listen(side) {
    const pad = document.getElementById(`${side}-pad`), thumb = pad.firstElementChild;
    const move = (event) => {
      const box = pad.getBoundingClientRect(), reach = box.width / 2;
      const x = (event.clientX - box.x) / reach - 1, y = 1 - (event.clientY - box.y) / reach;
      const shrink = Math.max(1, Math.hypot(x, y));
      this.show(side, thumb, x / shrink, y / shrink);
    };
    pad.addEventListener("pointerdown", (event) => {
      pad.setPointerCapture(event.pointerId);
      move(event);
    });
    pad.addEventListener("pointermove", (event) => pad.hasPointerCapture(event.pointerId) && move(event));
    pad.addEventListener("lostpointercapture", () => this.show(side, thumb, 0, 0));
  }

  show(side, thumb, x, y) {
    this.pads[side] = [x, y];
    thumb.style.transform = `translate(${50 * x}%, ${-50 * y}%)`;
  }

  asked() {
    const asked = { forward: 0, left: 0, up: 0, turn: 0 };
    for (const code of this.held) asked[FLIES[code][0]] += FLIES[code][1];
    this.addSticks(asked, this.pads.left, this.pads.right);
    for (const gamepad of navigator.getGamepads?.() ?? []) if (gamepad) this.addGamepad(asked, gamepad);
    for (const axis of AXES) asked[axis] = Math.max(-1, Math.min(1, asked[axis]));
    return asked;
  }

  addSticks(asked, [x, y], [turn, up]) {
    asked.left -= x;
    asked.forward += y;
    asked.turn -= turn;
    asked.up += up;
  }

  addGamepad(asked, { axes, buttons }) {
    const [x, y, turn, up] = [0, 1, 2, 3].map((n) => (Math.abs(axes[n] ?? 0) < DEAD_ZONE ? 0 : axes[n]));
    this.addSticks(asked, [x, -y], [turn, -up]);
    GAMEPAD_PRESSES.forEach((what, n) => {
      const isPressed = buttons[n]?.pressed ?? false;
      if (isPressed && !this.buttons[n]) this.press(what);
      this.buttons[n] = isPressed;
    });
  }
}

// A velocity in the world for a vehicle with this heading, m/s, of SPEED at most.
function commandOf({ forward, left, up }, heading) {
  const shrink = SPEED / Math.max(1, Math.hypot(forward, left, up));
  const cos = Math.cos(heading), sin = Math.sin(heading);
  return [cos * forward - sin * left, sin * forward + cos * left, up].map((part) => shrink * part);
}
