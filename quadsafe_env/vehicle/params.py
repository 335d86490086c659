"""Physical parameters of a quadrotor, and three presets from public sources."""

from collections.abc import Mapping
from typing import NamedTuple

from quadsafe_core.checks import finite_array, one_of, positive_number
from quadsafe_env.vehicle.presets import from_mapping, from_sequence

GRAVITY = 9.81
# The flat map is singular at zero thrust. Below this fraction of the hover thrust the model counts as
# crashed; the value is a choice, small enough to leave nearly free fall to the pilot.
THRUST_FLOOR = 0.05


class QuadrotorParams(NamedTuple):
    """Constants of a quadrotor, all SI floats.

    | field        | unit  | meaning                                                              |
    |--------------|-------|----------------------------------------------------------------------|
    | mass         | kg    | m                                                                    |
    | inertia      | kg m² | principal moments (J_x, J_y, J_z) about the body axes                |
    | arm          | m     | centre to rotor axis                                                 |
    | radius       | m     | collision radius: arm plus propeller radius                          |
    | thrust_max   | N     | all four rotors at full speed                                        |
    | thrust_min   | N     | floor of the thrust f_z, below which the model counts as crashed     |
    | torque_max   | N m   | largest torque about each body axis, reached at half of thrust_max   |
    | gravity      | m/s²  | g                                                                    |
    | yaw_rate_max | rad/s | largest ω_z that the vehicle is flown with; 10, what observations    |
    |              |       | show, unless another is given                                        |
    """

    mass: float
    inertia: tuple[float, float, float]
    arm: float
    radius: float
    thrust_max: float
    thrust_min: float
    torque_max: tuple[float, float, float]
    gravity: float
    yaw_rate_max: float = 10.0

    @property
    def specific_thrust_min(self) -> float:
        """The floor as a specific thrust, m/s²; the ``thrust_min`` of an ``Authority`` lies above it."""
        return self.thrust_min / self.mass

    @property
    def specific_thrust_max(self) -> float:
        """Full thrust as a specific thrust, m/s²; the ``thrust_max`` of an ``Authority`` lies below it."""
        return self.thrust_max / self.mass


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


def _preset(mass, inertia, arm, propeller, thrust_max, moment_ratio) -> QuadrotorParams:
    return QuadrotorParams(
        mass=mass,
        inertia=inertia,
        arm=arm,
        radius=arm + propeller,
        thrust_max=thrust_max,
        thrust_min=THRUST_FLOOR * mass * GRAVITY,
        torque_max=x_torque_max(arm, thrust_max, moment_ratio),
        gravity=GRAVITY,
    )


PRESETS = {
    # Crazyflie 2.x: gym-pybullet-drones, assets/cf2x.urdf (thrust-to-weight 2.25; k_f in N/rpm², k_m in
    # N m/rpm²).
    "crazyflie": _preset(
        mass=0.027,
        inertia=(1.4e-5, 1.4e-5, 2.17e-5),
        arm=0.0397,
        propeller=0.0231348,
        thrust_max=2.25 * 0.027 * GRAVITY,
        moment_ratio=7.94e-12 / 3.16e-10,
    ),
    # AscTec Hummingbird: OmniDrones, usd/hummingbird.yaml; propeller radius: RotorS, hummingbird.xacro. Both
    # place the rotors on the body axes; here they stand between them, as on the other two.
    "hummingbird": _preset(
        mass=0.716,
        inertia=(7e-3, 7e-3, 1.2e-2),
        arm=0.17,
        propeller=0.1,
        thrust_max=4.0 * 8.54858e-6 * 838.0**2,
        moment_ratio=0.016,
    ),
    # Racer: gym-pybullet-drones, assets/racer.urdf (thrust-to-weight 4.17). It gives 12.7 cm as the radius of
    # a five-inch propeller; that is the diameter, and rotors 13.5 cm apart would not turn otherwise.
    "racer": _preset(
        mass=0.83,
        inertia=(3.113e-3, 3.113e-3, 3.113e-3),
        arm=0.109,
        propeller=0.0635,
        thrust_max=4.17 * 0.83 * GRAVITY,
        moment_ratio=2.13e-11 / 8.47e-9,
    ),
}
DEFAULT = "crazyflie"
# Checked already; the table above keeps them alive.
CHECKED = {id(preset) for preset in PRESETS.values()}


def params_from(value: "str | Mapping | QuadrotorParams | list | tuple") -> QuadrotorParams:
    """Checked parameters, every number a float.

    Args:
        value: name of a preset; or a mapping of fields, the missing ones taken from the preset named under
            "preset" (default "crazyflie"); or a QuadrotorParams, or the plain list that JSON makes of it.

    Raises:
        TypeError: for a value or field of another kind.
        ValueError: for an unknown preset or field, or a field out of range.
    """
    if isinstance(value, str):
        return PRESETS[one_of("params", value, tuple(PRESETS))]
    if id(value) in CHECKED:
        return value  # type: ignore[return-value]
    if isinstance(value, Mapping):
        return _checked(from_mapping("params", value, PRESETS, DEFAULT))
    if isinstance(value, (tuple, list)):
        # The last field has a default, and came later.
        return _checked(from_sequence("params", value, QuadrotorParams, len(QuadrotorParams._fields) - 1))
    raise TypeError(f"params must be a preset name, a mapping or a QuadrotorParams, got {value!r}")


def _checked(params: QuadrotorParams) -> QuadrotorParams:
    checked = QuadrotorParams._make(_field(name, value) for name, value in params._asdict().items())
    Jx, Jy, Jz = sorted(checked.inertia)
    if Jx + Jy < Jz:
        raise ValueError(f"inertia must satisfy the triangle inequality, got {checked.inertia}")
    hover = checked.mass * checked.gravity
    if not checked.thrust_min < hover < checked.thrust_max:
        raise ValueError(
            f"thrust_min and thrust_max must enclose the hover thrust {hover:g} N, "
            f"got {checked.thrust_min:g} and {checked.thrust_max:g}"
        )
    return checked


def _field(name: str, value):
    if name not in ("inertia", "torque_max"):
        return positive_number(name, value)
    entries = finite_array(name, value, (3,))
    if entries.shape != (3,) or not (entries > 0).all():
        raise ValueError(f"{name} must be three numbers > 0, got {value!r}")
    x, y, z = entries.tolist()
    return (x, y, z)
