// A pilot that flies at the nearest shape, and after a while at it at the nearest that it has not yet flown at.
"use strict";

const PATIENCE = 150; // periods at one shape
const STEP = 1e-5; // m, for slopes of distances

class Fool {
  constructor(engine) {
    this.engine = engine;
    this.forget();
  }

  forget() {
    this.tried = new Set();
    this.at = -1;
    this.left = 0;
  }

  // A velocity in the world, m/s.
  command(i) {
    const place = this.engine.position(i);
    if (this.left === 0) this.choose(place);
    this.left -= 1;
    const slope = this.slope(place);
    const length = Math.hypot(...slope) || 1;
    return slope.map((part) => (-SPEED * part) / length);
  }

  choose(place) {
    const count = this.engine.scene.shapes.length;
    if (this.tried.size === count) this.tried.clear();
    const left = [...Array(count).keys()].filter((k) => !this.tried.has(k));
    const distances = left.map((k) => this.engine.c.distance(k, ...place));
    this.at = left[distances.indexOf(Math.min(...distances))];
    this.tried.add(this.at);
    this.left = PATIENCE;
  }

  slope(place) {
    return [0, 1, 2].map((axis) => {
      const [low, high] = [-STEP, STEP].map((step) => {
        const near = [...place];
        near[axis] += step;
        return this.engine.c.distance(this.at, ...near);
      });
      return high - low;
    });
  }
}

// Numbers from 0 to 1 that are the same in each run (mulberry32).
function drawn(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

// A free place within a metre of the scene's start, at rest there.
function putDown(engine, i, random) {
  do {
    engine.c.place(i, ...engine.scene.start.map((part) => part + 2 * random() - 1));
  } while (engine.clearance(i) < 0.02);
}

// Flights of the pilot, each once with and once without the shield: how many of each crashed, and how near the
// ones with the shield came.
function attackFlights(flights, periods) {
  const engine = new Engine();
  const found = { with: 0, without: 0, uncertified: 0, acted: 0, clearance: Infinity };
  for (let flight = 0; flight < flights; ++flight) {
    engine.load(SCENES[flight % SCENES.length]);
    for (const i of [SHIELDED, BARE]) {
      putDown(engine, i, drawn(flight));
      flyAttack(engine, i, periods, found);
    }
  }
  return found;
}

function flyAttack(engine, i, periods, found) {
  const fool = new Fool(engine);
  for (let period = 0; period < periods; ++period) {
    const isCrashed = engine.step(i, fool.command(i), i === SHIELDED);
    if (i === SHIELDED) {
      found.uncertified += !engine.isCertified(i);
      found.acted += engine.correction(i) > 0;
      found.clearance = Math.min(found.clearance, engine.clearance(i));
    }
    if (isCrashed) {
      found[i === SHIELDED ? "with" : "without"] += 1;
      return;
    }
  }
}
