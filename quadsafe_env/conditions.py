"""Real conditions: errors of the estimate, the link, the air, the model and the clock, all off by default.

| field                | unit    | off by default; what it switches on                                       |
|----------------------|---------|---------------------------------------------------------------------------|
| `position_noise`, …  | m, …    | radius of an error of the estimate, new in every control period: uniform  |
|                      |         | in the ball; one radius for each row of the flat state, up to             |
|                      |         | `jerk_noise`, m/s³                                                        |
| `position_bias`, …   | m, …    | length of an error of the estimate, one for an episode: uniform on the    |
|                      |         | sphere; up to `jerk_bias`, m/s³                                           |
| `delay`              | periods | control periods between the filter's answer and its flight; before the    |
|                      |         | first answer, snap and yaw acceleration 0 are flown                       |
| `loss`               | –       | probability that the answer of a control period is lost                   |
| `wind`               | m/s²    | constant acceleration of this length, its direction new in an episode     |
| `gust`               | m/s²    | peak of a gust (1 − cos)/2 of ``GUST_LENGTH``, one in ``GUST_PERIOD``     |
| `turbulence`         | m/s²    | standard deviation, per axis, of first-order Gauss–Markov noise with time |
|                      |         | constant ``TURBULENCE_TIME``, shortened to three of it in norm            |
| `drag`               | 1/s     | acceleration −drag·v                                                      |
| `gain`               | –       | (1 + e) times the snap is flown, \\|e\\| ≤ gain, one e for an episode     |
| `mass_error`         | –       | true over believed mass in [1 − e, 1 + e], one factor for an episode      |
| `inertia_error`      | –       | the same for the three moments of inertia together                        |
| `rotor_lag`          | s       | time constant of a first-order lag of the wrench (F_z, τ)                 |
| `jitter`             | –       | length of a control period over its nominal length in [1 − j, 1 + j], in  |
|                      |         | whole physics steps, at least one                                         |
| `impulse`            | m/s     | length of a sudden change of the velocity in a random direction           |
| `impulse_rate`       | 1/s     | of such changes; one happens in a period T with probability 1 − e^(−rT)   |

What is random is uniform, but for the turbulence, and a function of the scene's integer and of the number of
control periods flown: the same scene is the same weather. ``docs/conditions.md`` has the formulas, and what the
filter and the policy see.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from quadsafe_core.checks import non_negative_number, one_of
from quadsafe_core.jit import inline_kernel

# Choices: a gust of a second, short beside a flight, and one of them in every four seconds.
GUST_LENGTH = 1.0  # s
GUST_PERIOD = 4.0  # s
# A choice near the scale of Dryden's model over speed: a few metres of air that pass at a few metres a second.
TURBULENCE_TIME = 0.5  # s
TURBULENCE_LIMIT = 3.0  # standard deviations of one axis


class Conditions(NamedTuple):
    """What a flight meets beyond the model; the module's text has fields and units. The default is nothing."""

    position_noise: float = 0.0
    velocity_noise: float = 0.0
    acceleration_noise: float = 0.0
    jerk_noise: float = 0.0
    position_bias: float = 0.0
    velocity_bias: float = 0.0
    acceleration_bias: float = 0.0
    jerk_bias: float = 0.0
    delay: int = 0
    loss: float = 0.0
    wind: float = 0.0
    gust: float = 0.0
    turbulence: float = 0.0
    drag: float = 0.0
    gain: float = 0.0
    mass_error: float = 0.0
    inertia_error: float = 0.0
    rotor_lag: float = 0.0
    jitter: float = 0.0
    impulse: float = 0.0
    impulse_rate: float = 0.0


OFF = Conditions()
CONDITIONS = {
    "off": OFF,
    # Domain randomisation. Mass, inertia and gain: ±20 %, the middle one of the spreads of 10, 20 and 30 % that
    # "One Net to Rule Them All" (2025, arXiv:2504.21586) compares on real racers. Estimate and rotors:
    # "Sim-to-(Multi)-Real" (2019, arXiv:1903.04628) and its simulator, standard deviations of 5 mm and 1 cm/s
    # an axis, taken here as the radius of the same spread, √5 of it, and a settling time of 0.15 s, four time
    # constants. Delay, wind, turbulence, drag and jitter are choices.
    "randomised": Conditions(
        position_noise=0.011,
        velocity_noise=0.022,
        delay=1,
        wind=0.3,
        turbulence=0.1,
        drag=0.1,
        gain=0.2,
        mass_error=0.2,
        inertia_error=0.2,
        rotor_lag=0.0375,
        jitter=0.2,
    ),
}
PROBABILITIES = ("loss",)
FRACTIONS = ("gain", "mass_error", "inertia_error", "jitter")


def conditions_from(value: "str | Mapping | Conditions | list | tuple | None") -> Conditions:
    """Checked conditions, every number but the delay a float.

    Args:
        value: None for none; name of a preset in ``CONDITIONS``; a mapping of fields, the missing ones taken
            from the preset named under "preset" (default "off"); or Conditions, or the plain list that JSON
            makes of them.

    Raises:
        TypeError: for a value or field of another kind.
        ValueError: for an unknown preset or field, or a field out of range.
    """
    if value is None:
        return OFF
    if isinstance(value, str):
        return CONDITIONS[one_of("conditions", value, tuple(CONDITIONS))]
    if isinstance(value, Mapping):
        return _checked(_completed(value))
    if isinstance(value, tuple | list):
        return _checked(_from_sequence(value))
    raise TypeError(f"conditions must be a preset name, a mapping or Conditions, got {value!r}")


def _completed(fields: Mapping) -> Conditions:
    given = dict(fields)
    preset = given.pop("preset", "off")
    for name in given:
        one_of("a field of conditions", name, Conditions._fields)
    return CONDITIONS[one_of("conditions preset", preset, tuple(CONDITIONS))]._replace(**given)


def _from_sequence(values: "tuple | list") -> Conditions:
    if len(values) != len(Conditions._fields):
        wanted = ", ".join(Conditions._fields)
        raise ValueError(f"conditions as a sequence must hold {wanted}, got {len(values)} values")
    return Conditions(*values)


def _checked(conditions: Conditions) -> Conditions:
    checked = Conditions._make(_field(name, value) for name, value in conditions._asdict().items())
    if (checked.impulse > 0.0) != (checked.impulse_rate > 0.0):
        raise ValueError(
            f"impulse and impulse_rate must both be 0 or both be > 0, "
            f"got {checked.impulse:g} and {checked.impulse_rate:g}"
        )
    return checked


def _field(name: str, value: Any) -> float | int:
    if name == "delay":
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
            raise ValueError(f"delay must be an integer >= 0, got {value!r}")
        return int(value)
    number = non_negative_number(name, value)
    if name in PROBABILITIES and number > 1.0:
        raise ValueError(f"{name} must be in [0, 1], got {value!r}")
    if name in FRACTIONS and number >= 1.0:
        raise ValueError(f"{name} must be in [0, 1), got {value!r}")
    return number


class Disturbance(NamedTuple):
    """What the kernels are told of conditions: the numbers that they need, in the order of the table above."""

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
    lag_kept: float
    lag_mean: float
    jitter: float
    impulse: float
    impulse_chance: float


def disturbance(c: Conditions, control_period: float, dt: float) -> Disturbance:
    """Conditions as numbers of a control period and a physics step ``dt``, s.

    Over half a physics step drag and air turn v into ``half_drag v + half_push a``, the solution of
    v̇ = a − drag v. Over a whole one the lag turns what it remembers, w, of the asked wrench u into
    u + lag_kept (w − u), and gives u + lag_mean (w − u) in the mean, the solution of rotor_lag ẇ = u − w.
    """
    lag = -math.expm1(-dt / c.rotor_lag) if c.rotor_lag > 0.0 else 1.0
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
        lag_kept=1.0 - lag,
        lag_mean=lag * c.rotor_lag / dt,
        jitter=c.jitter,
        impulse=c.impulse,
        impulse_chance=-math.expm1(-c.impulse_rate * control_period),
    )


@inline_kernel
def unpacked_disturbance(c):
    """The disturbance whose numbers are packed in ``c``, see ``quadsafe_env.plant``."""
    return Disturbance(
        (c[0], c[1], c[2], c[3]),
        (c[4], c[5], c[6], c[7]),
        c[8],
        c[9],
        c[10],
        c[11],
        c[12],
        c[13],
        c[14],
        c[15],
        c[16],
        c[17],
        c[18],
        c[19],
        c[20],
        c[21],
        c[22],
    )
