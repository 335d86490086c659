"""Physical parameters of a quadrotor, and presets; ``docs/vehicles.md`` has the source of each number."""

import warnings
from collections.abc import Mapping
from typing import NamedTuple

from numpy.typing import ArrayLike

from quadsafe_core.checks import finite_array, keywords_known_to, keywords_of, one_of, positive_number
from quadsafe_core.presets import from_mapping, from_sequence
from quadsafe_env.vehicle.airframe import GRAVITY, PROPELLER, Airframe, misfits


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
        """The floor as a specific thrust, m/s²; that of an ``Authority`` lies above it."""
        return self.thrust_min / self.mass

    @property
    def specific_thrust_max(self) -> float:
        """Full thrust as a specific thrust, m/s²; that of an ``Authority`` lies below it."""
        return self.thrust_max / self.mass

    @classmethod
    @keywords_known_to("QuadrotorParams.from_airframe")
    def from_airframe(
        cls,
        *,
        mass: float,
        arm: float,
        motor_thrust_max: float,
        propeller_radius: float | None = None,
        propeller_inertia: float | None = None,
        inertia: ArrayLike | None = None,
        moment_ratio: float | None = None,
        gravity: float = GRAVITY,
        yaw_rate_max: float = 10.0,
    ) -> "QuadrotorParams":
        """A quadrotor in X of which little is known: what is None is estimated by the rule of ``Airframe``.

        ``Airframe`` has the arguments and the rule; ``Airframe(…).assumptions()`` says what was estimated.

        Args:
            yaw_rate_max: largest ω_z that the vehicle is flown with, rad/s.

        Warns:
            UserWarning: where a given inertia does not fit mass and arm, with the ratio.

        Raises:
            TypeError, ValueError: for a number out of its range, or motors that do not lift the mass.
        """
        frame = Airframe(
            mass=mass,
            arm=arm,
            motor_thrust_max=motor_thrust_max,
            propeller_radius=propeller_radius,
            propeller_inertia=propeller_inertia,
            inertia=inertia,
            moment_ratio=moment_ratio,
            gravity=gravity,
        )
        return fitting(_of_airframe(frame, yaw_rate_max))


def _preset(levers: tuple[float, float] | None = None, **known) -> QuadrotorParams:
    """A vehicle of an airframe; ``levers`` of the rotors about x and y, m, where they are not the same."""
    params = QuadrotorParams(**Airframe(**known).fields())
    if levers is None:
        return params
    pair = 0.5 * params.thrust_max
    return params._replace(torque_max=(levers[0] * pair, levers[1] * pair, params.torque_max[2]))


# Of one, with its propeller, kg.
ROTOR_MASS = 0.0160769

PRESETS = {
    # Crazyflie 2.x: gym-pybullet-drones, assets/cf2x.urdf (thrust-to-weight 2.25; k_f in N/rpm², k_m in
    # N m/rpm²).
    "crazyflie": _preset(
        mass=0.027,
        inertia=(1.4e-5, 1.4e-5, 2.17e-5),
        arm=0.0397,
        propeller_radius=0.0231348,
        motor_thrust_max=2.25 * 0.027 * GRAVITY / 4.0,
        moment_ratio=7.94e-12 / 3.16e-10,
    ),
    # Crazyflie 2.1 Brushless: utiasDSL/drone-models, drone_models/data/params.toml, cf21B_500. Its L is the
    # lever about x and y.
    "crazyflie_brushless": _preset(
        mass=0.04338,
        inertia=(25e-6, 28e-6, 49e-6),
        arm=2.0**0.5 * 0.035355,
        propeller_radius=0.0275,
        motor_thrust_max=0.18,
        moment_ratio=0.00593893393599368,
    ),
    # AscTec Hummingbird: OmniDrones, usd/hummingbird.yaml; propeller radius: RotorS, hummingbird.xacro. Both
    # place the rotors on the body axes; here they stand between them, as on the others.
    "hummingbird": _preset(
        mass=0.716,
        inertia=(7e-3, 7e-3, 1.2e-2),
        arm=0.17,
        propeller_radius=0.1,
        motor_thrust_max=8.54858e-6 * 838.0**2,
        moment_ratio=0.016,
    ),
    # Racer with five-inch propellers: gym-pybullet-drones, assets/racer.urdf (thrust-to-weight 4.17). It gives
    # 12.7 cm as their radius; that is the diameter, and rotors 13.5 cm apart would not turn otherwise.
    "racer": _preset(
        mass=0.83,
        inertia=(3.113e-3, 3.113e-3, 3.113e-3),
        arm=0.109,
        propeller_radius=0.0635,
        motor_thrust_max=4.17 * 0.83 * GRAVITY / 4.0,
        moment_ratio=2.13e-11 / 8.47e-9,
    ),
    # Research frame, 250 mm across: uzh-rpg/flightmare, flightpy/configs/control/config.yaml. Its rotors stand
    # at (±0.075, ±0.1) m, hence the torque. It gives no propellers: they are of the rule for rotors that far
    # apart on every side as these on the short ones.
    "research_250": _preset(
        mass=0.752,
        inertia=(2.5e-3, 2.1e-3, 4.3e-3),
        arm=0.125,
        propeller_radius=PROPELLER * 2.0**0.5 * 0.075,
        motor_thrust_max=1.562522e-6 * 2333.0**2,
        moment_ratio=0.022,
        levers=(0.1, 0.075),
    ),
    # X500: PX4/PX4-gazebo-models, models/x500_base/model.sdf and models/x500/model.sdf: the body with four
    # rotors, and a propeller as long as its box.
    "x500": _preset(
        mass=2.0 + 4 * ROTOR_MASS,
        inertia=tuple(
            body + 4 * ROTOR_MASS * square
            for body, square in zip(
                (0.0216667, 0.0216667, 0.04), (0.174**2, 0.174**2, 2 * 0.174**2), strict=True
            )
        ),
        arm=2.0**0.5 * 0.174,
        propeller_radius=0.2792308 / 2,
        motor_thrust_max=8.54858e-6 * 1000.0**2,
        moment_ratio=0.016,
    ),
    # The same frame, propellers and motors at 1.5 kg: the mass is a choice, and the inertia of the rule.
    "x500_light": _preset(
        mass=1.5,
        arm=2.0**0.5 * 0.174,
        propeller_radius=0.2792308 / 2,
        motor_thrust_max=8.54858e-6 * 1000.0**2,
        moment_ratio=0.016,
    ),
}
DEFAULT = "crazyflie"
# Checked already; the table above keeps them alive.
CHECKED = {id(preset) for preset in PRESETS.values()}


def params_from(value: "str | Mapping | QuadrotorParams | list | tuple") -> QuadrotorParams:
    """Checked parameters, every number a float.

    Args:
        value: name of a preset; or a mapping of fields, the missing ones taken from the preset named under
            "preset" (default "crazyflie"); or a mapping with "motor_thrust_max", which holds the arguments of
            ``from_airframe``; or a QuadrotorParams, or the plain list that JSON makes of it.

    Raises:
        TypeError: for a value or field of another kind.
        ValueError: for an unknown preset or field, or a field out of range.
    """
    if isinstance(value, str):
        return PRESETS[one_of("params", value, tuple(PRESETS))]
    if id(value) in CHECKED:
        return value  # type: ignore[return-value]
    if isinstance(value, Mapping) and "motor_thrust_max" in value:
        return _from_known(value)
    if isinstance(value, Mapping):
        return _checked(from_mapping("params", value, PRESETS, DEFAULT))
    if isinstance(value, (tuple, list)):
        # The last field has a default, and came later.
        return _checked(from_sequence("params", value, QuadrotorParams, len(QuadrotorParams._fields) - 1))
    raise TypeError(f"params must be a preset name, a mapping or a QuadrotorParams, got {value!r}")


def fitting(params: QuadrotorParams) -> QuadrotorParams:
    """``params`` as they are.

    Warns:
        UserWarning: where inertia or torque do not fit mass, arm and thrust, with the ratio: ``misfits``.
    """
    for sentence in misfits(params):
        warnings.warn(f"params: {sentence}", UserWarning, stacklevel=3)
    return params


def _from_known(given: Mapping) -> QuadrotorParams:
    """A vehicle by the arguments of ``from_airframe``."""
    for name in given:
        one_of("a field of params with motor_thrust_max", name, keywords_of(QuadrotorParams.from_airframe))
    if missing := [name for name in ("mass", "arm") if name not in given]:
        raise ValueError(
            f"params with motor_thrust_max must have mass and arm, got no {' and no '.join(missing)}"
        )
    frame = dict(given)
    yaw_rate_max = frame.pop("yaw_rate_max", QuadrotorParams._field_defaults["yaw_rate_max"])
    return _of_airframe(Airframe(**frame), yaw_rate_max)


def _of_airframe(frame: Airframe, yaw_rate_max: float) -> QuadrotorParams:
    return _checked(QuadrotorParams(**frame.fields(), yaw_rate_max=yaw_rate_max))


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
