// The loop, the buttons and the words.
"use strict";

const TIMES = [[1, "1×"], [0.5, "½×"], [0.25, "¼×"], [0.1, "⅒×"]];
const TURN = 2.4; // rad/s
const LONGEST_FRAME = 0.05; // s; a slower machine flies slower

const element = (id) => document.getElementById(id);
const matches = (query) => matchMedia(query).matches;

class Page {
  constructor() {
    this.engine = new Engine();
    this.game = new Game(this.engine);
    this.view = new View(element("view"), matches("(prefers-color-scheme: dark)"), matches("(prefers-reduced-motion: reduce)"));
    this.fool = new Fool(this.engine);
    this.pilot = new Pilot((what) => this.press(what));
    this.isAttacking = false;
    this.time = 0;
    this.work = []; // ms of script, of the last frames
    for (const id of ["shield", "attack", "time", "next", "help", "close"]) this.listen(id);
    this.open(0);
  }

  listen(id) {
    element(id).addEventListener("click", (event) => {
      this.press(id);
      // After a click, keys fly again; who came by the keyboard stays.
      if (event.detail > 0) element(id).blur();
    });
  }

  press(what) {
    ({
      shield: () => this.game.toggle(),
      attack: () => { this.isAttacking = !this.isAttacking; this.fool.forget(); },
      time: () => { this.time = (this.time + 1) % TIMES.length; },
      next: () => this.open(this.game.number + 1),
      restart: () => this.open(this.game.number),
      help: () => this.showHelp(element("words").hidden),
      close: () => this.showHelp(false),
    })[what]();
    this.write();
  }

  showHelp(isShown) {
    const isLeft = !isShown && element("words").contains(document.activeElement);
    element("words").hidden = !isShown;
    element("help").setAttribute("aria-expanded", isShown);
    if (isLeft) element("help").focus();
  }

  open(number) {
    this.game.open(number);
    this.view.open(this.engine.scene);
    this.fool.forget();
    this.heading = 0;
    this.owed = 0;
    this.before = this.poses();
    this.view.sample(this.game);
    this.write();
  }

  poses() {
    return [SHIELDED, BARE].map((i) => ({
      place: [...this.engine.position(i)], acceleration: [...this.engine.acceleration(i)],
    }));
  }

  // A control period.
  fly(asked) {
    this.before = this.poses();
    const { own } = this.game;
    const command = this.isAttacking ? this.fool.command(own) : commandOf(asked, this.heading);
    this.game.fly(command);
    this.turn(this.isAttacking ? this.turnTo(command) : asked.turn);
    if (Math.hypot(...this.before[own].place.map((part, n) => part - this.engine.position(own)[n])) > 0.1) {
      this.before = this.poses();
      this.view.restart();
    }
    this.view.sample(this.game);
  }

  turn(share) { this.heading += share * TURN * PERIOD; }

  turnTo([x, y]) {
    if (Math.hypot(x, y) < 0.3) return 0;
    const left = Math.atan2(y, x) - this.heading;
    return Math.max(-1, Math.min(1, 2 * Math.atan2(Math.sin(left), Math.cos(left))));
  }

  frame(now) {
    const begun = performance.now();
    const since = (now - (this.now ?? now)) / 1000, passed = Math.min(since, LONGEST_FRAME);
    this.now = now;
    if (since < 1) this.view.keepPace(since);
    this.owed += passed * TIMES[this.time][0];
    const asked = this.pilot.asked();
    for (; this.owed >= PERIOD; this.owed -= PERIOD) this.fly(asked);
    this.view.draw(this.game, this.between(this.owed / PERIOD), this.heading);
    this.write();
    this.work.push(performance.now() - begun);
    if (this.work.length > 2000) this.work.shift();
    requestAnimationFrame((next) => this.frame(next));
  }

  between(share) {
    const mix = (a, b) => a.map((part, n) => part + share * (b[n] - part));
    return this.poses().map(({ place, acceleration }, i) => ({
      place: mix(this.before[i].place, place), acceleration: mix(this.before[i].acceleration, acceleration),
    }));
  }

  write() {
    const { game, engine } = this;
    say("with", game.crashes.with);
    say("without", game.crashes.without);
    say("state", `${engine.scene.title.replace("QuadSafe/", "")} · ${stateOf(game)}`);
    say("told", game.told);
    say("time", `Time ${TIMES[this.time][1]}`);
    say("shield", game.isOn ? "Shield on" : "Shield off");
    element("shield").setAttribute("aria-pressed", game.isOn);
    element("attack").setAttribute("aria-pressed", this.isAttacking);
  }
}

function say(id, text) {
  const place = element(id);
  if (place.textContent !== String(text)) place.textContent = text;
}

function stateOf({ engine, isOn, isEngaged, own }) {
  const clearance = Math.max(0, 100 * engine.clearance(own)), near = `${clearance.toFixed(clearance < 10 ? 1 : 0)} cm clear`;
  if (!isOn) return `${near}, no shield`;
  if (!isEngaged) return near;
  return engine.correction(own) > 0 ? `${near}, the shield acts` : `${near}, as you asked`;
}

const page = new Page();
requestAnimationFrame((now) => page.frame(now));
