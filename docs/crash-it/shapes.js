// Meshes of the shapes of a scene, and of a quadrotor.
"use strict";

const UP = new THREE.Vector3(0, 0, 1);
const GRID = 0.5; // m

function materialsOf(colors) {
  const solid = (color) => new THREE.MeshLambertMaterial({ color });
  const glass = (color, opacity) =>
    new THREE.MeshLambertMaterial({ color, opacity, transparent: true, depthWrite: false });
  return {
    box: solid(colors.box), round: solid(colors.round), hidden: glass(colors.box, 0.22),
    wall: new THREE.MeshLambertMaterial({ map: gridTexture(colors) }),
    edge: new THREE.LineBasicMaterial({ color: colors.edge }),
  };
}

function gridTexture({ wall, grid }) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const paint = canvas.getContext("2d");
  paint.fillStyle = wall;
  paint.fillRect(0, 0, 64, 64);
  paint.strokeStyle = grid;
  paint.lineWidth = 2;
  paint.strokeRect(0, 0, 64, 64);
  const texture = new THREE.CanvasTexture(canvas);
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.anisotropy = 4;
  return texture;
}

function meshOf(shape, materials) {
  if (shape.shape === "half_space") return null;
  const { geometry, place, turn } = SOLIDS[shape.shape](shape);
  const mesh = new THREE.Mesh(geometry, shape.shape === "box" ? materials.box : materials.round);
  mesh.position.fromArray(place);
  mesh.quaternion.copy(turn);
  mesh.userData.material = mesh.material;
  mesh.castShadow = mesh.receiveShadow = true;
  if (shape.shape === "box") mesh.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry), materials.edge));
  return mesh;
}

const SOLIDS = {
  sphere: ({ center, radius }) => ({
    geometry: new THREE.SphereGeometry(radius, 32, 20), place: center, turn: new THREE.Quaternion(),
  }),
  box: ({ center, size, rotation = NO_ROTATION }) => {
    const rows = rotation.map((row) => [...row, 0]).flat();
    const turn = new THREE.Quaternion().setFromRotationMatrix(new THREE.Matrix4().set(...rows, 0, 0, 0, 1));
    return { geometry: new THREE.BoxGeometry(...size), place: center, turn };
  },
  capsule: (shape) => along(shape, (length) => new THREE.CapsuleGeometry(shape.radius, length, 6, 16)),
  cylinder: (shape) => along(shape, (length) => new THREE.CylinderGeometry(shape.radius, shape.radius, length, 32)),
};

// Round bodies of three stand along y.
function along({ start, end }, geometryOf) {
  const a = new THREE.Vector3(...start), b = new THREE.Vector3(...end), axis = b.clone().sub(a);
  const length = axis.length(), middle = a.add(b).multiplyScalar(0.5);
  const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), axis.normalize());
  return { geometry: geometryOf(length), place: middle.toArray(), turn };
}

// Low and high corner of the room that walls across the axes enclose; without walls one around the shapes.
function extentOf({ shapes, start }) {
  const low = start.map((part) => part - 3), high = start.map((part) => part + 3);
  for (const { center } of shapes) {
    for (let axis = 0; center && axis < 3; ++axis) {
      low[axis] = Math.min(low[axis], center[axis] - 1.2);
      high[axis] = Math.max(high[axis], center[axis] + 1.2);
    }
  }
  for (const { shape, normal, offset } of shapes) {
    if (shape !== "half_space") continue;
    const axis = normal.findIndex((part) => part !== 0);
    (normal[axis] > 0 ? low : high)[axis] = normal[axis] * offset;
  }
  return { low, high };
}

// Seen from inside alone. Without walls there is a floor, to see how deep it is, that nothing can hit.
function wallsOf(scene, materials) {
  const { low, high } = extentOf(scene), walls = scene.shapes.filter(({ shape }) => shape === "half_space");
  const normals = walls.length ? walls.map(({ normal }) => normal) : [[0, 0, 1]];
  return normals.map((normal) => wallOf(normal, low, high, materials.wall));
}

function wallOf(normal, low, high, material) {
  const size = high.map((part, axis) => part - low[axis]), n = new THREE.Vector3(...normal);
  const [width, height] = normal[0] ? [size[2], size[1]] : normal[1] ? [size[0], size[2]] : [size[0], size[1]];
  const geometry = new THREE.PlaneGeometry(width, height);
  const uv = geometry.attributes.uv;
  for (let i = 0; i < uv.count; ++i) uv.setXY(i, (uv.getX(i) * width) / GRID, (uv.getY(i) * height) / GRID);
  const mesh = new THREE.Mesh(geometry, material);
  mesh.quaternion.setFromUnitVectors(UP, n);
  mesh.position.set(...low.map((part, axis) => (part + high[axis]) / 2 - (normal[axis] * size[axis]) / 2));
  mesh.receiveShadow = true;
  return mesh;
}

// A quadrotor along x, within a ball of this radius.
function quadrotorOf(radius, color) {
  const group = new THREE.Group(), reach = 0.62 * radius;
  const paint = new THREE.MeshLambertMaterial({ color });
  const dark = new THREE.MeshLambertMaterial({ color: 0x30343c });
  const add = (geometry, material, x, y, z) => {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.position.set(x, y, z);
    mesh.castShadow = true;
    group.add(mesh);
    return mesh;
  };
  add(new THREE.BoxGeometry(0.7 * radius, 0.42 * radius, 0.26 * radius), paint, 0, 0, 0);
  add(new THREE.BoxGeometry(0.2 * radius, 0.26 * radius, 0.14 * radius), dark, 0.38 * radius, 0, 0.04 * radius);
  for (const turn of [1, -1]) {
    add(new THREE.BoxGeometry(1.8 * reach, 0.1 * radius, 0.08 * radius), dark, 0, 0, 0).rotation.z = (turn * Math.PI) / 4;
  }
  const disc = new THREE.CylinderGeometry(0.34 * radius, 0.34 * radius, 0.03 * radius, 24);
  const blur = new THREE.MeshLambertMaterial({ color, transparent: true, opacity: 0.55 });
  for (const [x, y] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
    const at = reach * Math.SQRT1_2;
    add(disc, blur, x * at, y * at, 0.16 * radius).rotation.x = Math.PI / 2;
    add(new THREE.BoxGeometry(0.1 * radius, 0.1 * radius, 0.18 * radius), dark, x * at, y * at, 0.06 * radius);
  }
  const ball = new THREE.MeshBasicMaterial({ color, transparent: true, opacity: 0.13, depthWrite: false });
  group.add(new THREE.Mesh(new THREE.SphereGeometry(radius, 24, 16), ball));
  return group;
}

// A thing that points along z, as long as it is told.
function arrowOf(color) {
  const group = new THREE.Group(), material = new THREE.MeshBasicMaterial({ color });
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.006, 0.006, 1, 10), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(0.02, 0.05, 14), material);
  shaft.rotation.x = head.rotation.x = Math.PI / 2;
  group.add(shaft, head);
  group.setLength = (length) => {
    shaft.scale.y = Math.max(length - 0.05, 1e-3);
    shaft.position.z = shaft.scale.y / 2;
    head.position.z = length - 0.025;
  };
  return group;
}
