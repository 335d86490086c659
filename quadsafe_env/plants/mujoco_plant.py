"""MuJoCo: a quadrotor as an MJCF, its motors actuators that lag, its obstacles geoms that collide."""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from quadsafe_core.shapes import Box, Capsule, Cylinder, HalfSpace, Shape, Sphere, shape_from
from quadsafe_env.plants.on_board import RotorPlant
from quadsafe_env.vehicle.params import QuadrotorParams, params_from
from quadsafe_env.vehicle.rotors import levers

# Its compiled half has no types.
mujoco: Any = import_module("mujoco")
# All that a step of the simulation begins from.
REMEMBERED = mujoco.mjtState.mjSTATE_INTEGRATION
# A Crazyflie's rotors settle to 2 % in 0.15 s, four time constants (arXiv 1903.04628).
LAG = 0.0375
MODEL = """
<mujoco>
  <option timestep="{step!r}" integrator="RK4" gravity="0 0 {gravity!r}" density="1.2" viscosity="1.8e-5">
    <flag autoreset="disable"/>
  </option>
  <worldbody>
    <body name="vehicle">
      <freejoint/>
      <inertial pos="0 0 0" mass="{mass!r}" diaginertia="{inertia}"/>
      <geom name="vehicle" type="sphere" size="{radius!r}"/>
      {sites}
    </body>
    {bodies}
  </worldbody>
  <actuator>
    {motors}
  </actuator>
</mujoco>
"""
# Signs of the places along x and y, and of the drag torques: front left, rear left, rear right, front right.
ROTORS = ((1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1))


class MujocoPlant(RotorPlant):
    """A quadrotor in MuJoCo, integrated by its RK4 step, in air that drags (its inertia-box model).

    The vehicle collides as the sphere around it, and is pushed back; ``contacts`` counts the steps at whose end
    MuJoCo itself finds the sphere in a body: two counters, one truth. Numbers that are no longer finite stay
    so: MuJoCo's own reset would put the vehicle back to its start without a word.

    Args:
        obstacles: spheres, boxes, capsules, cylinders and half-spaces at rest, as in ``fly``.
        params: of the vehicle, as in ``quadsafe_env.QuadrotorParams``.
        lag: time constant of the motors, s.
        step: of the physics, s.

    Raises:
        TypeError, ValueError: for what is no such thing, for an obstacle that moves, and for one of another
            kind.
    """

    def __init__(
        self,
        *,
        obstacles: Sequence[Any] = (),
        params: Any = "crazyflie",
        lag: float = LAG,
        step: float = 0.001,
    ):
        super().__init__(params_from(params), lag, step)
        self._build([shape_from(body) for body in obstacles])

    def among(self, shapes):
        """See ``WithBodies``: of bodies that move, hulls and ellipsoids there are no geoms."""
        geoms = [shape for shape in shapes if type(shape) in GEOMS and not any(shape.velocity)]
        if geoms != self._shapes:
            self._build(geoms)

    def _build(self, shapes: Sequence[Shape]) -> None:
        self._shapes = shapes
        self.model = mujoco.MjModel.from_xml_string(_model(self.params, self.lag, self.step, shapes))
        self.data = mujoco.MjData(self.model)
        self.contacts = 0

    def place(self, body, thrusts):
        """See ``RotorPlant``."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:3], self.data.qvel[:3] = body[:3], body[3:6]
        mujoco.mju_mat2Quat(self.data.qpos[3:], body[6:15])
        self.data.qvel[3:], self.data.act[:] = body[15:18], thrusts
        self.contacts = int(self._collides())

    def measure(self):
        """See ``RotorPlant``."""
        body = np.empty(18)
        body[:3], body[3:6], body[15:] = self.data.qpos[:3], self.data.qvel[:3], self.data.qvel[3:]
        mujoco.mju_quat2Mat(body[6:15], self.data.qpos[3:])
        return body, self.data.act

    def advance(self, commands):
        """See ``RotorPlant``."""
        self.data.ctrl[:] = commands
        mujoco.mj_step(self.model, self.data)
        self.contacts += self._collides()

    def remembered(self):
        """See ``WithMemory``."""
        simulated = np.empty(mujoco.mj_stateSize(self.model, REMEMBERED))
        mujoco.mj_getState(self.model, self.data, simulated, REMEMBERED)
        return np.array([*self._asked, self.saturated, self.contacts, *simulated])

    def recall(self, memory):
        """See ``WithMemory``."""
        self._asked[:], (self.saturated, self.contacts) = memory[:2], map(int, memory[2:4])
        mujoco.mj_setState(self.model, self.data, memory[4:], REMEMBERED)

    def _collides(self) -> bool:
        """Whether MuJoCo finds the vehicle in a body where it now is: a step leaves the contacts before it."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        return bool((self.data.contact.dist < 0.0).any())


def _model(params: QuadrotorParams, lag: float, step: float, shapes: Sequence[Shape]) -> str:
    """The MJCF of a vehicle among bodies."""
    x, y, drag = levers(params)
    sites = [f'<site name="{i}" pos="{y * a!r} {x * b!r} 0"/>' for i, (a, b, _) in enumerate(ROTORS)]
    motors = [
        f'<general site="{i}" gear="0 0 1 0 0 {drag * c!r}" dyntype="filter" dynprm="{lag!r}" '
        f'ctrllimited="true" ctrlrange="0 {params.thrust_max / 4!r}"/>'
        for i, (_, _, c) in enumerate(ROTORS)
    ]
    return MODEL.format(
        step=step,
        gravity=-params.gravity,
        mass=params.mass,
        inertia=_numbers(params.inertia),
        radius=params.radius,
        sites="\n".join(sites),
        bodies="\n".join(map(_geom, shapes)),
        motors="\n".join(motors),
    )


def _geom(shape: Shape) -> str:
    """A body at rest as a geom of MJCF."""
    write = GEOMS.get(type(shape))
    if write is None:
        known = ", ".join(kind.__name__ for kind in GEOMS)
        raise ValueError(f"an obstacle of the plant 'mujoco' must be a {known}, got {shape!r}")
    if any(shape.velocity):  # type: ignore[attr-defined]
        raise ValueError(f"an obstacle of the plant 'mujoco' must be at rest, got {shape!r}")
    return f"<geom {write(shape)}/>"


def _numbers(values: Any) -> str:
    """Numbers as MJCF has them, every digit kept."""
    return " ".join(map(repr, np.asarray(values, dtype=float).tolist()))


def _box(box: Any) -> str:
    axes = np.eye(3) if box.rotation is None else np.array(box.rotation).T
    size = _numbers(np.array(box.size) / 2)
    return f'type="box" pos="{_numbers(box.center)}" size="{size}" xyaxes="{_numbers(axes[:2].ravel())}"'


def _round(kind: str) -> Callable[[Any], str]:
    return lambda body: (
        f'type="{kind}" fromto="{_numbers([*body.start, *body.end])}" size="{float(body.radius)!r}"'
    )


GEOMS: dict[type, Callable[[Any], str]] = {
    Sphere: lambda ball: f'type="sphere" pos="{_numbers(ball.center)}" size="{float(ball.radius)!r}"',
    Box: _box,
    Capsule: _round("capsule"),
    Cylinder: _round("cylinder"),
    HalfSpace: lambda wall: (
        f'type="plane" size="1 1 1" pos="{_numbers(np.multiply(wall.normal, wall.offset))}" '
        f'zaxis="{_numbers(wall.normal)}"'
    ),
}
