"""Shapes at random, of each kind, for tests that hold for all."""

import numpy as np
from scipy.spatial.transform import Rotation

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Sphere

KINDS = ("sphere", "capsule", "cylinder", "box", "hull", "ellipsoid", "half_space")


def random_shape(rng, kind):
    """A shape of a kind, about 1 m in size and 1 m from the origin."""
    a, b, edges, r = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.05, 2.0, 3), rng.uniform(0.05, 1.0)
    rotation = Rotation.random(random_state=rng)
    made = {
        "sphere": lambda: Sphere(a, r),
        "capsule": lambda: Capsule(a, b, r),
        "cylinder": lambda: Cylinder(a, b, r),
        "box": lambda: Box(a, edges, rotation),
        "hull": lambda: Hull(rng.normal(size=(rng.integers(4, 20), 3)), r * (rng.random() < 0.5)),
        "ellipsoid": lambda: Ellipsoid(a, edges, rotation),
        "half_space": lambda: HalfSpace(a, b[0]),
    }
    return made[kind]()


def degenerate_shapes():
    """Shapes without an inside, and others at the ends of what a kind allows: name and shape."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    turned = Rotation.from_euler("xyz", [0.3, 0.5, 0.7]).as_matrix()
    return {
        "capsule of length zero": Capsule((1, 2, 3), (1, 2, 3), 0.5),
        "capsule of radius zero": Capsule((0, 0, 0), (1, 1, 1), 0.0),
        "cylinder of radius zero": Cylinder((0, 0, 0), (1, 1, 1), 0.0),
        "thin disc": Cylinder((0, 0, 0), (0, 0, 1e-9), 1.0),
        "plate": Box((0, 0, 1), (1, 2, 0), turned),
        "rod": Box((0, 0, 1), (0, 2, 0), turned),
        "box that is a point": Box((0, 0, 1), (0, 0, 0)),
        "hull that is a point": Hull([(1, 2, 3)]),
        "hull of coincident points": Hull([(1, 2, 3)] * 5, 0.1),
        "hull that is a segment": Hull([(0, 0, 0), (1, 2, 3), (0.5, 1, 1.5), (0.5, 1, 1.5)]),
        "flat hull": Hull(np.column_stack([corners[:, :2], np.zeros(8)]) @ turned.T),
        "nearly flat hull": Hull(corners * (1, 1, 1e-10) @ turned.T),
        "needle-like hull": Hull(corners * (1, 1e-7, 1e-9) @ turned.T),
        "hull with doubled corners": Hull(np.repeat(corners, 3, axis=0)),
        "hull with points within": Hull(np.vstack([corners, corners / 2 + 0.2])),
        "disc-like ellipsoid": Ellipsoid((0, 0, 1), (1, 2, 1e-6), turned),
        "needle-like ellipsoid": Ellipsoid((0, 0, 1), (1, 1e-6, 1e-5), turned),
        "ellipsoid that is a ball": Ellipsoid((0, 0, 1), (0.5, 0.5, 0.5)),
        "round ellipsoid": Ellipsoid((0, 0, 1), (0.5, 0.5, 1.5)),
    }


def core_points(rng, shape, count):
    """Points of the body without its ball, on its surface and within, (count, 3)."""
    body = shape.body()
    z = rng.uniform(-1.0, 1.0, (count, 3))
    z /= np.where(rng.random((count, 1)) < 0.5, np.abs(z).max(axis=1, keepdims=True), 1.0)
    if shape.name == "hull":
        weights = rng.dirichlet(np.full(len(body.vertices), 0.3), count)
        return body.center + weights @ body.vertices
    if shape.name == "half_space":
        return body.center + np.column_stack([-np.abs(z[:, 0]), z[:, 1:]]) * 3.0 @ body.axes
    if shape.name in ("ellipsoid", "sphere"):
        z /= np.maximum(1.0, np.linalg.norm(z, axis=1, keepdims=True))
    half = np.array(body.half)
    if shape.name in ("capsule", "cylinder"):
        z[:, 1:] /= np.maximum(1.0, np.linalg.norm(z[:, 1:], axis=1, keepdims=True))
        half = half[[0, 1, 1]]
    return body.center + z * half @ body.axes
