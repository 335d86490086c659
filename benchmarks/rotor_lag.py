"""What is left of a rotor lag that the inner loop is told of: the snap that is flown against the one asked for.

    python benchmarks/rotor_lag.py                the table of docs/conditions.md
    python benchmarks/rotor_lag.py --told 1.2     an inner loop that is told 1.2 T
    python benchmarks/rotor_lag.py --thrust 1     flights down to a specific thrust of 1 m/s²

A Crazyflie at 500 Hz flies snaps of 200 m/s⁴, in control periods of 10 ms in the direction that the law
of the velocity interface asks for at the lead state r + T ṙ, after velocities of up to 5 m/s an axis, new in
every half second. A flight begins again at hover after 2 s, or where the specific thrust falls below 4 m/s².
For every physics step, with u asked for, s flown at first and the mean s̄ flown, ‖s̄ − u‖ is what a plant that
does not know the lag is off, and the norm of d = (s̄ − μ s − (1 − μ) u)/(1 − μ) what the lagged chain
T ṡ = u + d − s is disturbed by.
"""

import argparse
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import norm, scale, subtract
from quadsafe_env.disturbances.draws import WEATHER
from quadsafe_env.disturbances.rotor_lag import asked_wrench, lag_lead, lag_of_step, lagged
from quadsafe_env.vehicle.actions import VelocityGains, velocity_feedback, velocity_gains
from quadsafe_env.vehicle.flatness import flat_from_state, snap_from_wrench_kernel
from quadsafe_env.vehicle.params import PRESETS, QuadrotorParams
from quadsafe_env.vehicle.rigid_body import rk4_step
from quadsafe_env.vehicle.state import THRUST, hover_state

DT, SUBSTEPS, TARGET_PERIODS = 0.002, 5, 50
SPEED, SNAP, FLIGHT = 5.0, 200.0, 1000
LAGS = (0.01, 0.02, 0.0375, 0.072)


class Pilot(NamedTuple):
    """The vehicle and its clock, as ``asked_wrench`` reads them; its pilot; its lag, s; its end, m/s²."""

    params: QuadrotorParams
    dt: float
    gains: VelocityGains
    lag: float
    least_thrust: float


@kernel
def wanted(s, given, target, pilot):
    """A snap as long as ``SNAP`` towards that of the velocity law, from the lead state."""
    _, v, a, j = flat_from_state(s, pilot.params)
    snap, T, k = snap_from_wrench_kernel(s, given, pilot.params), pilot.lag, pilot.gains
    u = (
        velocity_feedback(v[0] + T * a[0] - target[0], a[0] + T * j[0], j[0] + T * snap[0], k),
        velocity_feedback(v[1] + T * a[1] - target[1], a[1] + T * j[1], j[1] + T * snap[1], k),
        velocity_feedback(v[2] + T * a[2] - target[2], a[2] + T * j[2], j[2] + T * snap[2], k),
    )
    return scale(SNAP / max(norm(u), 1.0), u)


@kernel
def fly(hover, targets, pilot, lead, weather, out):
    """Fly through the targets (M, 3); ‖s̄ − u‖ and ‖d‖ of every physics step into ``out`` (K, 2)."""
    m, s, u = weather[0], hover, (0.0, 0.0, 0.0)
    w, mean = m["wrench"], m["lag"][1]
    for k in range(out.shape[0]):
        given = (w[0], w[1], w[2], w[3])
        if k % SUBSTEPS == 0:
            row = targets[k // (SUBSTEPS * TARGET_PERIODS)]
            u = wanted(s, given, (row[0], row[1], row[2]), pilot)
        snap, jerk = snap_from_wrench_kernel(s, given, pilot.params), flat_from_state(s, pilot.params)[3]
        s = rk4_step(s, lagged(asked_wrench(s, u, 0.0, pilot, lead, m), m), pilot.params, pilot.dt)
        off = subtract(scale(1.0 / pilot.dt, subtract(flat_from_state(s, pilot.params)[3], jerk)), u)
        out[k, 0] = norm(off)
        out[k, 1] = norm(subtract(off, scale(mean, subtract(snap, u)))) / (1.0 - mean)
        if s[THRUST] < pilot.least_thrust * pilot.params.mass or (k + 1) % FLIGHT == 0:
            s, w[:], m["believed"][:] = hover, 0.0, 0.0


def measured(lag: float, told: float | None, steps: int, least_thrust: float) -> NDArray[np.float64]:
    """Rows ‖s̄ − u‖ and ‖d‖, m/s⁴, of a flight with this lag, and a loop that is told of another, or of none."""
    params, weather = PRESETS["crazyflie"], np.zeros(1, dtype=WEATHER)
    weather["lag"] = lag_of_step(lag, DT)
    targets = np.random.default_rng(0).uniform(-SPEED, SPEED, (steps // (SUBSTEPS * TARGET_PERIODS) + 1, 3))
    hover: Any = tuple(hover_state([0.0, 0.0, 0.0], params).tolist())
    out = np.empty((steps, 2))
    lead = None if told is None else lag_lead(told, DT)
    pilot = Pilot(params, DT, velocity_gains(SUBSTEPS * DT), lag, least_thrust)
    fly(hover, targets, pilot, lead, weather, out)
    return out


def cells(values: NDArray[np.float64]) -> str:
    """Median, 99 % and largest."""
    return " / ".join(f"{number:,.0f}" for number in np.quantile(values, (0.5, 0.99, 1.0)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--told", type=float, default=1.0, help="told over true time constant")
    parser.add_argument("--steps", type=int, default=1_000_000, help="physics steps of every flight")
    parser.add_argument("--thrust", type=float, default=4.0, help="specific thrust that ends a flight, m/s²")
    asked = parser.parse_args()
    print("| T, ms | off the snap asked for, m/s⁴ | disturbance of the lagged chain | with the compensation |")
    print("|---:|---:|---:|---:|")
    for lag in LAGS:
        plain, led = (measured(lag, told, asked.steps, asked.thrust) for told in (None, asked.told * lag))
        print(
            f"| {1000 * lag:g} | {cells(plain[:, 0])} | {cells(plain[:, 1])} | {cells(led[:, 1])} |", flush=True
        )


if __name__ == "__main__":
    main()
