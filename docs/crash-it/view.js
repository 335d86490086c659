// What is seen: the scene, both quadrotors, the correction, the stored stop, the path, from behind.
"use strict";

const GRAVITY = 9.81;
const BEHIND = 0.85, ABOVE = 0.32, AHEAD = 0.5, NEAR_CEILING = 0.04; // m
// What a slow machine does without, step by step: shadows, then pixels.
const LEVELS = [{ shadow: true, pixels: 2 }, { shadow: false, pixels: 1 }, { shadow: false, pixels: 0.7 }, { shadow: false, pixels: 0.5 }];
const SLOW = 1 / 45, WINDOW = 1; // s, of a frame; in which it is judged
const PATH = 240; // points
const LONGEST = 0.42, HALF_AT = 150; // m; m/s4, where the arrow has half of that
const LIGHT = {
  sky: 0xdfe6ee, wall: "#eef1f5", grid: "#cfd6df", box: 0xc2ccd8, round: 0xa9bccb, edge: 0x8793a3,
  own: 0x2462d0, bare: 0xd23c3c, stop: 0x0b8f6f, acts: 0xe08a00, path: 0x7f97c9,
};
const DARK = {
  sky: 0x12161d, wall: "#232a35", grid: "#39424f", box: 0x566173, round: 0x5d7286, edge: 0x8390a3,
  own: 0x5c9bff, bare: 0xff6b63, stop: 0x3ddcb0, acts: 0xffb02e, path: 0x6f88bd,
};

class View {
  constructor(canvas, isDark, isCalm) {
    this.colors = isDark ? DARK : LIGHT;
    this.isCalm = isCalm;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.shadowMap.enabled = true;
    this.level = this.frames = this.spent = 0;
    this.camera = new THREE.PerspectiveCamera(62, 1, 0.02, 40);
    this.camera.up.copy(UP);
    this.materials = materialsOf(this.colors);
    this.ray = new THREE.Raycaster();
    this.moving = this.movingThings();
    this.resize();
    addEventListener("resize", () => this.resize());
  }

  resize() {
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, LEVELS[this.level].pixels));
    this.renderer.setSize(innerWidth, innerHeight, false);
    this.camera.aspect = innerWidth / innerHeight;
    // As much of what is beside the vehicle on a narrow screen.
    this.camera.fov = innerWidth < innerHeight ? 78 : 62;
    this.camera.updateProjectionMatrix();
  }

  // Draw less where frames take long.
  keepPace(seconds) {
    this.frames += 1;
    this.spent += seconds;
    if (this.spent < WINDOW) return;
    const isSlow = this.spent / this.frames > SLOW;
    this.frames = this.spent = 0;
    if (!isSlow || this.level === LEVELS.length - 1) return;
    this.level += 1;
    this.lamp.castShadow = LEVELS[this.level].shadow;
    this.resize();
  }

  movingThings() {
    const { acts, stop, path } = this.colors;
    this.arrow = arrowOf(acts);
    this.stop = lineOf(128, new THREE.LineBasicMaterial({ color: stop }));
    this.path = lineOf(PATH, new THREE.LineBasicMaterial({ vertexColors: true }));
    this.path.geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * PATH), 3));
    this.pathColors = [new THREE.Color(path), new THREE.Color(acts)];
    return [this.arrow, this.stop, this.path];
  }

  open(scene) {
    this.drop();
    const { low, high } = extentOf(scene);
    // Above a ceiling there is nothing to see.
    this.ceiling = high[2] - NEAR_CEILING;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(this.colors.sky);
    this.solids = scene.shapes.map((shape) => meshOf(shape, this.materials)).filter(Boolean);
    this.quadrotors = [this.colors.own, this.colors.bare].map((color) => quadrotorOf(scene.radius, color));
    this.scene.add(...wallsOf(scene, this.materials), ...this.solids, ...this.quadrotors, ...this.moving);
    this.lamp = lampOver(low, high);
    this.lamp.castShadow = LEVELS[this.level].shadow;
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0xc4ccd6, 2.5), this.lamp);
    this.restart();
  }

  restart() {
    this.heading = null;
    this.pathLength = 0;
  }

  drop() {
    this.scene?.remove(...this.moving);
    this.scene?.traverse((thing) => thing.geometry?.dispose());
  }

  // One frame: places and accelerations of both, between two samples.
  draw(game, poses, heading) {
    for (const i of [SHIELDED, BARE]) pose(this.quadrotors[i], poses[i], heading);
    this.quadrotors[SHIELDED].visible = game.isOn;
    this.quadrotors[BARE].visible = !game.isOn || apart(poses) > game.engine.scene.radius / 4;
    this.aim(poses[game.own].place, heading);
    this.fade(poses[game.own].place);
    this.renderer.render(this.scene, this.camera);
  }

  // What changes with a control period.
  sample(game) {
    const { engine } = game, place = engine.position(game.own);
    const isActing = game.isOn && engine.correction(SHIELDED) > 0;
    this.addToPath(place, isActing);
    this.arrow.visible = isActing;
    if (isActing) this.turnArrow(engine, place);
    this.stop.geometry.setDrawRange(0, game.isOn ? engine.c.stop(SHIELDED) : 0);
    this.stop.geometry.attributes.position.array.set(engine.line);
    this.stop.geometry.attributes.position.needsUpdate = true;
  }

  turnArrow(engine, place) {
    const snap = engine.snap(SHIELDED), wanted = engine.wanted(SHIELDED), size = engine.correction(SHIELDED);
    const direction = new THREE.Vector3(...snap.map((part, n) => (part - wanted[n]) / size));
    this.arrow.position.fromArray(place);
    this.arrow.quaternion.setFromUnitVectors(UP, direction);
    this.arrow.setLength((LONGEST * size) / (size + HALF_AT));
  }

  addToPath(place, isActing) {
    const { position, color } = this.path.geometry.attributes;
    if (this.pathLength === PATH) {
      for (const { array } of [position, color]) array.copyWithin(0, 3);
      this.pathLength -= 1;
    }
    position.setXYZ(this.pathLength, ...place);
    color.setXYZ(this.pathLength, ...this.pathColors[Number(isActing)].toArray());
    position.needsUpdate = color.needsUpdate = true;
    this.pathLength += 1;
    this.path.geometry.setDrawRange(0, this.pathLength);
  }

  aim(place, heading) {
    const turned = this.heading === null ? 0 : Math.atan2(Math.sin(heading - this.heading), Math.cos(heading - this.heading));
    this.heading = this.heading === null || this.isCalm ? heading : this.heading + 0.15 * turned;
    const cos = Math.cos(this.heading), sin = Math.sin(this.heading);
    this.camera.position.set(place[0] - BEHIND * cos, place[1] - BEHIND * sin, Math.min(place[2] + ABOVE, this.ceiling));
    this.camera.lookAt(place[0] + AHEAD * cos, place[1] + AHEAD * sin, place[2] + 0.02);
  }

  // What stands between the camera and the vehicle is glass.
  fade(place) {
    const eye = this.camera.position, way = new THREE.Vector3(...place).sub(eye);
    this.ray.far = way.length();
    this.ray.set(eye, way.normalize());
    this.ray.camera = this.camera;
    const between = new Set(this.ray.intersectObjects(this.solids, false).map(({ object }) => object));
    for (const mesh of this.solids) {
      const isBetween = between.has(mesh) || isInside(mesh, eye);
      mesh.material = isBetween ? this.materials.hidden : mesh.userData.material;
    }
  }
}

function apart([a, b]) {
  return Math.hypot(...a.place.map((part, n) => part - b.place[n]));
}

const local = new THREE.Vector3();

// Whether a point is in the box around a mesh.
function isInside(mesh, point) {
  if (!mesh.geometry.boundingBox) mesh.geometry.computeBoundingBox();
  return mesh.geometry.boundingBox.containsPoint(mesh.worldToLocal(local.copy(point)));
}

function lineOf(count, material) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  const line = new THREE.Line(geometry, material);
  line.frustumCulled = false;
  return line;
}

function lampOver(low, high) {
  const lamp = new THREE.DirectionalLight(0xffffff, 1.3);
  const middle = low.map((part, axis) => (part + high[axis]) / 2);
  const reach = Math.max(high[0] - low[0], high[1] - low[1]) / 2 + 0.5;
  lamp.position.set(middle[0] - 1, middle[1] + 1.4, middle[2] + 6);
  lamp.target.position.set(...middle);
  lamp.target.updateMatrixWorld();
  Object.assign(lamp.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.5, far: 14 });
  lamp.shadow.mapSize.set(1024, 1024);
  lamp.shadow.bias = -0.002;
  return lamp;
}

// The attitude follows from the acceleration: the thrust is along a + g.
function pose(quadrotor, { place, acceleration }, heading) {
  const z = new THREE.Vector3(acceleration[0], acceleration[1], acceleration[2] + GRAVITY).normalize();
  const y = new THREE.Vector3().crossVectors(z, new THREE.Vector3(Math.cos(heading), Math.sin(heading), 0)).normalize();
  const x = new THREE.Vector3().crossVectors(y, z);
  quadrotor.position.fromArray(place);
  quadrotor.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(x, y, z));
}
