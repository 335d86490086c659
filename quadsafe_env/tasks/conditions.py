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
| `gust`               | m/s²    | peak of a gust (1 − cos)/2 of one second, one in every four seconds       |
| `turbulence`         | m/s²    | standard deviation, per axis, of first-order Gauss–Markov noise with a    |
|                      |         | time constant of 0.5 s, shortened to three of it in norm                  |
| `drag`               | 1/s     | acceleration −drag·v                                                      |
| `gain`               | –       | (1 + e) times the snap is flown, e in [−gain, gain], one for an episode   |
| `mass_error`         | –       | true over believed mass in [1 − e, 1 + e], one factor for an episode      |
| `inertia_error`      | –       | the same for the three moments of inertia together                        |
| `rotor_lag`          | s       | time constant of a first-order lag of the wrench (F_z, τ), or [least,     |
|                      |         | greatest] of one that is drawn for an episode                             |
| `jitter`             | –       | length of a control period over its nominal length in [1 − j, 1 + j], in  |
|                      |         | whole physics steps, at least one                                         |
| `impulse`            | m/s     | length of a sudden change of the velocity in a random direction           |
| `impulse_rate`       | 1/s     | of such changes; one happens in a period T with probability 1 − e^(−rT)   |
| `impulse_gap`        | s       | for so long after one there is no other                                   |
| `rotor_rise`, …      | s       | time constants of first-order lags of the thrusts of four rotors that     |
|                      |         | rise, and with `rotor_fall` fall; each then keeps to [0, thrust_max/4]    |

What is random is uniform, but for the turbulence, and a function of the scene's integer and of the number of
control periods flown: the same scene is the same weather. ``docs/conditions.md`` has the formulas, and what the
filter and the policy see.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from quadsafe_core.checks import checked_when_made, exact_array, non_negative_number, one_of
from quadsafe_core.presets import from_mapping, from_sequence

PROBABILITIES = ("loss",)
PAIRS = (("impulse", "impulse_rate"), ("rotor_rise", "rotor_fall"))
FRACTIONS = ("gain", "mass_error", "inertia_error", "jitter")


def _checked(conditions: "Conditions") -> "Conditions":
    """Every field in its range, and a float but for the delay."""
    checked = Conditions._make(_field(name, value) for name, value in conditions._asdict().items())
    for one, other in PAIRS:
        a, b = getattr(checked, one), getattr(checked, other)
        if (a > 0.0) != (b > 0.0):
            raise ValueError(f"{one} and {other} must both be 0 or both be > 0, got {a:g} and {b:g}")
    if checked.impulse_gap > 0.0 and checked.impulse == 0.0:
        raise ValueError(f"impulse_gap must be 0 without an impulse, got {checked.impulse_gap:g}")
    return checked


def _field(name: str, value: Any) -> float | int | tuple[float, float]:
    if name == "delay":
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
            raise ValueError(f"delay must be an integer >= 0, got {value!r}")
        return int(value)
    if name == "rotor_lag" and isinstance(value, tuple | list | np.ndarray):
        return _interval(name, value)
    number = non_negative_number(name, value)
    if name in PROBABILITIES and number > 1.0:
        raise ValueError(f"{name} must be in [0, 1], got {value!r}")
    if name in FRACTIONS and number >= 1.0:
        raise ValueError(f"{name} must be in [0, 1), got {value!r}")
    return number


def _interval(name: str, value: Any) -> float | tuple[float, float]:
    """A number for an interval of one."""
    low, high = exact_array(name, value, (2,)).tolist()
    if not 0.0 <= low <= high:
        raise ValueError(f"{name} must be [least, greatest] with 0 <= least <= greatest, got {value!r}")
    return low if low == high else (low, high)


@checked_when_made(_checked)
class Conditions(NamedTuple):
    """What a flight meets beyond the model; the module's text has fields and units. The default is nothing.

    Conditions with a field out of its range cannot be made.
    """

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
    rotor_lag: float | tuple[float, float] = 0.0
    jitter: float = 0.0
    impulse: float = 0.0
    impulse_rate: float = 0.0
    rotor_rise: float = 0.0
    rotor_fall: float = 0.0
    impulse_gap: float = 0.0


OFF = Conditions()
CONDITIONS = {
    "off": OFF,
    # What is left in a laboratory with motion capture and a vehicle that was weighed: choices. All of it can be
    # declared.
    "indoor": Conditions(
        position_noise=0.003,
        velocity_noise=0.01,
        position_bias=0.002,
        delay=1,
        loss=0.02,
        wind=0.1,
        turbulence=0.02,
        gain=0.03,
        mass_error=0.01,
    ),
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
# The turbulence is at most so many standard deviations long.
TURBULENCE_LIMIT = 3.0
# Error of the snap that the inner loop flies, m/s⁴: more than in 99.99 % of periods of random snaps at 50 to
# 200 Hz, and than in any within an authority; measured by ``benchmarks/robustness.py``.
INNER_LOOP = 15.0
# What bounds are for without other numbers, m/s.
SPEED_COUNTED_ON = 5.0


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
        return from_mapping("conditions", value, CONDITIONS, "off")
    if isinstance(value, tuple | list):
        return from_sequence("conditions", value, Conditions, len(Conditions._fields))
    raise TypeError(f"conditions must be a preset name, a mapping or Conditions, got {value!r}")


def lag_interval(conditions: Conditions) -> tuple[float, float]:
    """Least and greatest time constant of the rotors, s."""
    lag = conditions.rotor_lag
    return lag if isinstance(lag, tuple) else (lag, lag)


def followed_lag(conditions: Conditions) -> tuple[float, float]:
    """Least and greatest time constant of the one lag that a loop that is told makes of them, s.

    Of rotors that rise and fall with time constants of their own it is the greater one.
    """
    low, high = lag_interval(conditions)
    slowest = max(conditions.rotor_rise, conditions.rotor_fall)
    return low + slowest, high + slowest


def is_lag_told(value: "str | bool") -> bool:
    """Whether the inner loop is told of the lag, from the keyword ``lag_compensation``, "told" or False."""
    if value is False or value == "told":
        return bool(value)
    raise ValueError(f'lag_compensation must be "told" or False, got {value!r}')


def uncertainty_under(
    conditions: Conditions,
    *,
    speed: float,
    thrust: float,
    compensates_lag: bool = False,
    substeps: int | None = None,
) -> dict[str, Any]:
    """Bounds of what the conditions do to the flat state, by the names of ``shields.Uncertainty``.

        estimate  noise + bias
        snap      the inner loop's own error
        gain      (1 + gain)/(1 − ι) − 1 for an inertia error ι
        wind      wind + gust + 3 turbulence + drag · speed + μ/(1 − μ) · thrust for a mass error μ
        lag       what ``followed_lag`` has, if the inner loop is told of it
        jitter    that of whole physics steps

    A flat acceleration is that of the believed vehicle: what mass and air add to it is wind.

    Args:
        conditions: what a flight meets.
        speed: largest speed that is counted on, m/s.
        thrust: largest specific thrust of the believed vehicle that is counted on, m/s².
        compensates_lag: whether the inner loop is told of the rotors' lag.
        substeps: physics steps in a control period; None for any number.

    Raises:
        ValueError: for what has no such bounds: impulses without a gap, rotors that lag twice, or behind an
            inner loop that is not told.
    """
    met, (least, most) = conditions, followed_lag(conditions)
    if met.impulse > 0.0 and met.impulse_gap == 0.0:
        raise ValueError(
            f"impulse_gap must be > 0 for bounds of what an impulse of {met.impulse:g} m/s does, got 0"
        )
    if met.rotor_lag != 0.0 and met.rotor_rise > 0.0:
        raise ValueError(
            "rotor_lag must be 0 where rotor_rise and rotor_fall are not for bounds of what the conditions do, "
            f"got {met.rotor_lag}"
        )
    if most > 0.0 and not compensates_lag:
        raise ValueError('lag_compensation must be "told" for bounds of what rotors that lag do, got False')
    air = met.wind + met.gust + TURBULENCE_LIMIT * met.turbulence + met.drag * speed
    return {
        "position": met.position_noise + met.position_bias,
        "velocity": met.velocity_noise + met.velocity_bias,
        "acceleration": met.acceleration_noise + met.acceleration_bias,
        "jerk": met.jerk_noise + met.jerk_bias,
        "snap": INNER_LOOP,
        "gain": met.gain + (1.0 + met.gain) * met.inertia_error / (1.0 - met.inertia_error),
        "wind": air + met.mass_error / (1.0 - met.mass_error) * thrust,
        "delay": met.delay,
        "losses": met.loss > 0.0,
        "rotor_lag": most if least == most else (least, most),
        "impulse": met.impulse,
        "impulse_gap": met.impulse_gap,
        "jitter": met.jitter if substeps is None else jitter_in_steps(met.jitter, substeps),
    }


def jitter_in_steps(jitter: float, substeps: int) -> float:
    """How much shorter or longer a period of so many physics steps may be, in whole ones, as a share."""
    shortest = max(1, math.floor(substeps * (1.0 - jitter) + 0.5))
    return max(math.floor(substeps * (1.0 + jitter) + 0.5) - substeps, substeps - shortest) / substeps
