"""What the kernels are told of conditions: the numbers that a control period and a physics step need."""

import math
from typing import NamedTuple

from quadsafe_env.tasks.conditions import Conditions, lag_interval

# Choices: a gust of a second, short beside a flight, and one of them in every four seconds.
GUST_LENGTH = 1.0  # s
GUST_PERIOD = 4.0  # s
# A choice near the scale of Dryden's model over speed: a few metres of air that pass at a few metres a second.
TURBULENCE_TIME = 0.5  # s


class Disturbance(NamedTuple):
    """Conditions as kernels need them; ``disturbance`` has what the numbers that are no fields mean."""

    noise: tuple[float, float, float, float]
    bias: tuple[float, float, float, float]
    loss: float
    wind: float
    gust: float
    turbulence: float
    turbulence_kept: float
    half_drag: float
    half_push: float
    gain: float
    mass_error: float
    inertia_error: float
    lag: tuple[float, float]
    dt: float
    substeps: int
    jitter: float
    impulse: float
    impulse_chance: float
    impulse_rest: int


def disturbance(c: Conditions, control_period: float, dt: float) -> Disturbance:
    """Conditions as numbers of a control period and a physics step ``dt``, s.

    Over half a physics step drag and air turn v into ``half_drag v + half_push a``, the solution of
    v̇ = a − drag v.
    """
    return Disturbance(
        noise=c[0:4],
        bias=c[4:8],
        loss=c.loss,
        wind=c.wind,
        gust=c.gust,
        turbulence=c.turbulence,
        turbulence_kept=math.exp(-control_period / TURBULENCE_TIME),
        half_drag=math.exp(-0.5 * c.drag * dt),
        half_push=-math.expm1(-0.5 * c.drag * dt) / c.drag if c.drag > 0.0 else 0.5 * dt,
        gain=c.gain,
        mass_error=c.mass_error,
        inertia_error=c.inertia_error,
        lag=lag_interval(c),
        dt=dt,
        substeps=round(control_period / dt),
        jitter=c.jitter,
        impulse=c.impulse,
        impulse_chance=-math.expm1(-c.impulse_rate * control_period),
        impulse_rest=math.ceil(c.impulse_gap / dt * (1.0 - 1e-12)),
    )
