"""A vehicle of which little is known: the rule for what is not given, and how far numbers are from the rule.

    J = m L² (1/4, 1/4, 1/2) + 2 J_p (1, 1, 0)     propeller radius = 0.6 L     k_m/k_f = 0.2 propeller radii

for mass m, arm L and a propeller's inertia J_p about its axis. J is that of four point masses at the rotors
that hold half of the mass, the rest at the centre; a turning propeller adds half of J_p about an axis across
its own, and nothing about its own, on which it is free. The presets with sources of their own have 0.7 to 1.4
times this J_x and J_y, 0.6 to 1.2 times this J_z, 0.84 to 0.98 times this propeller radius, and 0.2 to 5.5
times this ratio of drag torque to thrust: it is the least certain of the three.
"""

import math
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from quadsafe_core.checks import finite_array, positive_number

GRAVITY = 9.81
# The flat map is singular at zero thrust. Below this fraction of the hover thrust the model counts as
# crashed; the value is a choice, small enough to leave nearly free fall to the pilot.
THRUST_FLOOR = 0.05
# Of m L²: about an axis across the thrust, and about the thrust.
ACROSS, ALONG = 1.0 / 4.0, 1.0 / 2.0
# Of the arm. Propellers of 0.71 would touch; a collision radius had better be too large than too small.
PROPELLER = 0.6
# Drag torque over thrust, of the propeller radius: the geometric mean of the presets.
MOMENT = 0.2
# How far inertia and torque may be from the rule: twice what the farthest preset is.
FIT = 3.0
# Units are surely wrong beyond these: presets have 100 to 640 kg/m³, 1.7 to 4.6 times the weight, 1.6 arms.
DENSITIES = (10.0, 6000.0)  # mass / arm³, kg/m³
THRUST_TO_WEIGHT = 30.0
LARGEST_RADIUS = 20.0  # arms
AXES = "xyz"


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """What is known of a quadrotor in X, and the rule for the rest: the module's text has it.

    Args:
        mass: m, of all that flies, kg.
        arm: L, centre to rotor axis, m.
        motor_thrust_max: of one rotor at full speed, N.
        propeller_radius: m; None: 0.6 L.
        propeller_inertia: J_p of one propeller about its axis, kg m²; None: 0.
        inertia: principal moments about the body axes, (3,), kg m², propellers included; None: m L²
            (1/4, 1/4, 1/2) + 2 J_p (1, 1, 0).
        moment_ratio: drag torque over thrust of one rotor, k_m/k_f, m; None: 0.2 propeller radii.
        gravity: g, m/s².

    Raises:
        TypeError, ValueError: for a number out of its range, or a propeller's inertia beside that of the whole.
    """

    mass: float
    arm: float
    motor_thrust_max: float
    propeller_radius: float | None = None
    propeller_inertia: float | None = None
    inertia: ArrayLike | None = None
    moment_ratio: float | None = None
    gravity: float = GRAVITY

    def __post_init__(self) -> None:
        for name in ("mass", "arm", "motor_thrust_max", "gravity"):
            positive_number(name, getattr(self, name))
        for name in ("propeller_radius", "propeller_inertia", "moment_ratio"):
            if getattr(self, name) is not None:
                positive_number(name, getattr(self, name))
        if self.inertia is not None and self.propeller_inertia is not None:
            raise ValueError(
                f"propeller_inertia must be left out beside inertia, which holds it, "
                f"got {self.propeller_inertia}"
            )

    def fields(self) -> dict[str, Any]:
        """The fields of ``QuadrotorParams``, but for the yaw rate."""
        propeller, thrust_max = self._propeller_radius(), 4.0 * self.motor_thrust_max
        ratio = MOMENT * propeller if self.moment_ratio is None else self.moment_ratio
        return {
            "mass": self.mass,
            "inertia": self._inertia(),
            "arm": self.arm,
            "radius": self.arm + propeller,
            "thrust_max": thrust_max,
            "thrust_min": THRUST_FLOOR * self.mass * self.gravity,
            "torque_max": x_torque_max(self.arm, thrust_max, ratio),
            "gravity": self.gravity,
        }

    def assumptions(self) -> tuple[str, ...]:
        """A sentence for each number that was not given and was estimated."""
        given, found = self.fields(), []
        if self.inertia is None:
            moments = ", ".join(f"{moment:.3g}" for moment in given["inertia"])
            added = "" if self.propeller_inertia is None else " + 2 propeller_inertia (1, 1, 0)"
            found.append(f"inertia is ({moments}) kg m², mass arm² (1/4, 1/4, 1/2){added}")
        if self.propeller_radius is None:
            found.append(f"propeller_radius is {self._propeller_radius():.3g} m, 0.6 arm")
        if self.moment_ratio is None:
            ratio = MOMENT * self._propeller_radius()
            found.append(f"moment_ratio is {ratio:.3g} m, 0.2 propeller_radius, known to a factor of 5")
        return tuple(found)

    def _propeller_radius(self) -> float:
        return PROPELLER * self.arm if self.propeller_radius is None else self.propeller_radius

    def _inertia(self) -> Any:
        if self.inertia is not None:
            return tuple(finite_array("inertia", self.inertia, (3,)).tolist())
        across, _, along = ruled_inertia(self.mass, self.arm)
        across += 2.0 * (self.propeller_inertia or 0.0)
        return (across, across, along)


def ruled_inertia(mass: float, arm: float) -> tuple[float, float, float]:
    """``m L² (1/4, 1/4, 1/2)``, kg m²."""
    square = mass * arm**2
    return (ACROSS * square, ACROSS * square, ALONG * square)


def x_torque_max(arm: float, thrust_max: float, moment_ratio: float) -> tuple[float, float, float]:
    """Largest torque about each body axis of an X configuration, two rotors at full thrust and two at zero.

    A rotor gives at most ``f = thrust_max / 4``. Two of them act on the lever ``arm / √2`` about x or y, and
    on ``moment_ratio`` about z: ``(√2 arm f, √2 arm f, 2 moment_ratio f)``.

    Args:
        arm: centre to rotor axis, m.
        thrust_max: all four rotors, N.
        moment_ratio: drag torque over thrust of one rotor, k_m / k_f, m.
    """
    rotor = thrust_max / 4.0
    roll = 2.0**0.5 * arm * rotor
    return (roll, roll, 2.0 * moment_ratio * rotor)


def misfits(params: Any) -> tuple[str, ...]:
    """What does not fit together: a sentence for inertia and for torque beyond a factor of 3 of the rule.

    Where these fit, mass, arm and thrust may still be in other units than kg, m and N together: a sentence for
    m/L³ and for F/(m g) beyond what any quadrotor has, and for a radius or a drag torque beyond the arm's.

    ``inertia`` is held against ``m L² (1/4, 1/4, 1/2)``, ``torque_max`` about x and y against ``√2 L F/4`` for
    F = ``thrust_max``. The torque about z is not: it has no rule that is good to a factor of 3.

    Args:
        params: a ``QuadrotorParams``.
    """
    ruled = ruled_inertia(params.mass, params.arm)
    torque = x_torque_max(params.arm, params.thrust_max, 0.0)[:2]
    of_inertia = f"mass {params.mass:g} kg and arm {params.arm:g} m"
    of_torque = f"thrust_max {params.thrust_max:g} N and arm {params.arm:g} m"
    return (
        *(_misfit("inertia", "kg m²", params.inertia, ruled, of_inertia) or _misscaled_arm(params)),
        *(_misfit("torque_max", "N m", params.torque_max[:2], torque, of_torque) or _misscaled_thrust(params)),
        *_misscaled_propeller(params),
    )


def _misscaled_arm(params) -> tuple[str, ...]:
    least, most = DENSITIES
    density = params.mass / params.arm / params.arm / params.arm
    if least <= density <= most:
        return ()
    return (
        f"mass and arm must be in kg and m, with mass / arm³ from {least:g} to {most:g} kg/m³, "
        f"got {params.mass:g} and {params.arm:g}, {density:.3g} kg/m³",
    )


def _misscaled_thrust(params) -> tuple[str, ...]:
    ratio = params.thrust_max / (params.mass * params.gravity)
    if ratio <= THRUST_TO_WEIGHT:
        return ()
    return (
        f"thrust_max must be in N, at most {THRUST_TO_WEIGHT:g} times the weight, "
        f"got {params.thrust_max:g}, {ratio:.3g} times {params.mass * params.gravity:.3g} N",
    )


def _misscaled_propeller(params) -> tuple[str, ...]:
    found = []
    if params.radius > LARGEST_RADIUS * params.arm:
        found.append(
            f"radius, arm and propeller, must be in m, at most {LARGEST_RADIUS:g} times arm {params.arm:g} m, "
            f"got {params.radius:g}"
        )
    lever = 2.0 * params.torque_max[2] / params.thrust_max
    if lever > params.arm:
        found.append(
            f"drag torque over thrust, moment_ratio or 2 torque_max[2] / thrust_max, must be in m, "
            f"at most arm {params.arm:g} m, got {lever:g}"
        )
    return tuple(found)


def _misfit(name, unit, values, ruled, given) -> tuple[str, ...]:
    """A sentence for the first entry that is too far from the rule, if there is one."""
    for axis, value, rule in zip(AXES, values, ruled, strict=False):
        if not rule <= FIT * value or not value <= FIT * rule:
            ratio = value / rule if rule > 0.0 else math.inf
            return (
                f"{name} about {axis} must fit {given}, of which the rule for airframes makes {rule:.3g} "
                f"{unit} within a factor of {FIT:g}, got {value:.3g}, {ratio:.3g} times that",
            )
    return ()
