"""A peer simulator behind the shield: RotorPy's Hummingbird, flown by RotorPy's own SE(3) controller.

    pip install "quadsafe[peer]"
    python examples/peer_simulator.py

A controller asks for a snap, ``Shield.filter`` answers with a safe one, and the integral of that is the flat
reference that RotorPy's controller tracks: its motors lag, its air drags, and it knows nothing of the shield.
The shield keeps the reference clear of the sphere, and the keep-out radius has room for the tracking error.

Measured with RotorPy 3.0.0, ten flights each, all of which arrive: without the shield the vehicle comes as far
as 0.594 m into the sphere, with it no nearer than 0.147 m. It stays within 0.114 m of its reference, for which
the room is 0.12 m. That room is a measurement, not a proof: another tracker, or wind, needs another.
"""

import sys
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shields import Obstacles, Shield

PERIOD, SECONDS = 0.01, 8.0
START, GOAL = np.array([-2.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.0])
CENTER, OBSTACLE, VEHICLE, ROOM = np.zeros(3), 0.5, 0.27, 0.12  # m; ROOM for the tracking error
HELD = np.array([PERIOD**n / f for n, f in ((4, 24), (3, 6), (2, 2), (1, 1))])
TAYLOR = np.array(
    [[PERIOD ** (k - i) / (1, 1, 2, 6)[k - i] if k >= i else 0.0 for k in range(4)] for i in range(4)]
)


def controller(flat: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
    """State feedback with a fourfold pole at −3/s, straight through the sphere."""
    return 81.0 * (goal - flat[0]) - 108.0 * flat[1] - 54.0 * flat[2] - 12.0 * flat[3]


def hovering(params: dict[str, Any], position: NDArray[np.float64]) -> dict[str, Any]:
    """RotorPy's state of a vehicle at rest."""
    speed = np.sqrt(params["mass"] * 9.81 / (params["num_rotors"] * params["k_eta"]))
    return {
        "x": position,
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(params["num_rotors"], speed),
    }


def fly(offset: tuple[float, float], shield: Shield | None) -> tuple[float, float, float]:
    """Least clearance of the vehicle, largest tracking error, and distance from the goal at the end, m."""
    from rotorpy.controllers.quadrotor_control import SE3Control  # pyright: ignore[reportMissingImports]
    from rotorpy.vehicles.hummingbird_params import quad_params  # pyright: ignore[reportMissingImports]
    from rotorpy.vehicles.multirotor import Multirotor  # pyright: ignore[reportMissingImports]

    sideways = np.array([0.0, *offset])
    vehicle, tracker = Multirotor(quad_params), SE3Control(quad_params)
    state, flat = hovering(quad_params, START + sideways), np.zeros((4, 3))
    flat[0] = START + sideways
    sphere = Obstacles.spheres(CENTER[None], np.array([OBSTACLE + VEHICLE + ROOM]))
    clearance, error = np.inf, 0.0
    for step in range(round(SECONDS / PERIOD)):
        snap = controller(flat, GOAL + sideways)
        if shield is not None:
            snap = shield.filter(flat, sphere, snap, PERIOD).snap
        names = ("x", "x_dot", "x_ddot", "x_dddot")
        reference = {**dict(zip(names, flat, strict=True)), "x_ddddot": snap, "yaw": 0.0, "yaw_dot": 0.0}
        command = tracker.update(step * PERIOD, state, reference)
        state = vehicle.step(state, command, PERIOD)
        flat = TAYLOR @ flat + np.outer(HELD, snap)
        clearance = min(clearance, float(np.linalg.norm(state["x"] - CENTER)) - OBSTACLE - VEHICLE)
        error = max(error, float(np.linalg.norm(state["x"] - flat[0])))
    return clearance, error, float(np.linalg.norm(state["x"] - GOAL - sideways))


def main() -> None:
    if find_spec("rotorpy") is None:
        sys.exit('peer_simulator.py: error: RotorPy must be installed: pip install "quadsafe[peer]"')
    offsets = np.random.default_rng(0).uniform(-0.4, 0.4, (10, 2)).tolist()
    for name, make in (("without shield", lambda: None), ("with shield", Shield)):
        results = np.array([fly(tuple(offset), make()) for offset in offsets])
        print(
            f"{name:15} least clearance {results[:, 0].min():+.3f} m, largest tracking error "
            f"{results[:, 1].max():.3f} m, {np.count_nonzero(results[:, 2] < 0.1)} of 10 arrived"
        )


if __name__ == "__main__":
    main()
