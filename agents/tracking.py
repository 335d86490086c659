"""Minimum-snap flights, and the agent that tracks them: the nominal controller of Section VI.

The flight minimises ∫ ‖r⁗‖² dt among those that pass the waypoints at the given times and rest at both ends.
It is the spline of degree 7 whose derivatives up to the sixth are continuous at the inner waypoints; between
two points it is ``35τ⁴ − 84τ⁵ + 70τ⁶ − 20τ⁷`` of the way.
"""

from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import make_interp_spline

from quadsafe_core.checks import finite_array, positive_number
from quadsafe_core.maths.feedback import held_gains
from quadsafe_env.vehicle.actions import SNAP, YAW_ACCELERATION
from quadsafe_env.vehicle.state import OMEGA

DEGREE = 7
ORDERS = 5  # position to snap
DURATION = 8.0  # s
FACTORIALS = np.array([factorial(k) for k in range(DEGREE + 1)], dtype=np.float64)
AT_REST = tuple((order, np.zeros(3)) for order in (1, 2, 3))


class MinimumSnap:
    """Minimum-snap flights through waypoints, from rest to rest.

    Args:
        waypoints: (…, M + 1, 3), m, with M ≥ 1.
        times: (…, M + 1), s, when each waypoint is passed; a single row serves all flights.

    Raises:
        ValueError: for wrong shapes, fewer than two waypoints, or times that do not increase.
    """

    def __init__(self, waypoints: ArrayLike, times: ArrayLike):
        points = finite_array("waypoints", waypoints, ("M + 1", 3))
        knots = finite_array("times", times, (points.shape[-2],))
        if points.shape[-2] < 2:
            raise ValueError(f"waypoints must be at least two, got {points.shape[-2]}")
        if not (np.diff(knots) > 0.0).all():
            raise ValueError(f"times must increase, got a step of {np.diff(knots).min():g} s")
        self._leading = points.shape[:-2]
        rows = points.reshape(-1, *points.shape[-2:])
        self._knots = np.broadcast_to(knots, points.shape[:-1]).reshape(rows.shape[:-1])
        self._derivatives = np.array([_knot_derivatives(p, t) for p, t in zip(rows, self._knots, strict=True)])

    def at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Position and its first four derivatives; at rest before the first and after the last waypoint.

        Args:
            time: s; its shape broadcasts with the leading shape of the waypoints.

        Returns:
            (…, 5, 3): r, ṙ, r̈, r⃛, r⁗ in m, m/s, …, m/s⁴.

        Raises:
            ValueError: for times that are not finite or do not broadcast.
        """
        moments = finite_array("time", time)
        flights = np.arange(len(self._knots)).reshape(self._leading)
        flights, moments = np.broadcast_arrays(flights, moments)
        knots = self._knots[flights]
        inside = np.clip(moments, knots[..., 0], knots[..., -1])
        segment = (inside[..., None] >= knots[..., 1:-1]).sum(axis=-1)
        since = inside - np.take_along_axis(knots, segment[..., None], axis=-1)[..., 0]
        motion = _taylor(self._derivatives[flights, segment], since)
        motion[inside != moments, 1:] = 0.0
        return motion


class Tracker:
    """Flies every row of an env to its goal along a minimum-snap path, in Track after its reference, untrained.

    Once per policy period Δ it asks for the mean snap of the path over the period plus a feedback,

        u = (r⃛_d(t + Δ) − r⃛_d(t))/Δ + K (x_d − x),   x = (r, ṙ, r̈, r⃛),

    whose K puts the four poles of the error, under a snap held for Δ, at e^(−pΔ). The yaw acceleration brakes
    ω_z at the same rate. The clock counts the calls of ``predict``. A snap beyond the range of the action is
    clipped by the env, entry by entry, and the flight lags behind: choose the duration so that this does not
    happen. The observation is not read; the flat state comes from the plant, so reset the env first.

    ``path`` holds the flights, one a row, with time counted from each row's start. In Track, x_d is the env's
    reference now, its snap takes the place of the mean, and ``path`` is not flown.

    Args:
        env: a QuadSafe env or vector env with ``action="snap"``, wrapped or not.
        duration: from the first waypoint to the goal, s; None for 8. In Track to be left out, as ``via``.
        via: (M − 1, 3) waypoints between start and goal, m; times are shared out by length.
        pole: p, 1/s.

    Raises:
        ValueError: for an env with another action interface, numbers out of range, or, in Track, a path.
    """

    def __init__(
        self, env: Any, duration: float | None = None, *, via: ArrayLike | None = None, pole: float = 3.0
    ):
        self._plant = env.unwrapped
        self._scale = np.array([SNAP, SNAP, SNAP, YAW_ACCELERATION])
        if not np.array_equal(getattr(self._plant, "action_scale", ()), self._scale):
            raise ValueError(f"env must be a QuadSafe environment with action='snap', got {env}")
        for name, value in (("duration", duration), ("via", via)):
            if value is not None and self._plant.follows:
                raise ValueError(f"{name} must be left out in Track, whose reference leads, got {value!r}")
        self._duration = positive_number("duration", DURATION if duration is None else duration)
        self._via = finite_array("via", np.empty((0, 3)) if via is None else via, ("M - 1", 3))
        self._period = 1.0 / self._plant.metadata["render_fps"]
        self._gains = held_gains(4, pole, self._period)
        self._yaw_gain = held_gains(1, pole, self._period)[0]
        self.reset()

    def reset(self, rows: ArrayLike | None = None) -> None:
        """Plan anew, from rest where the vehicles are now, and start the clock.

        Args:
            rows: (N,) booleans, which rows to plan; None for all.
        """
        start = self._plant.flat_state().reshape(-1, 4, 3)[:, 0]
        goal = self._plant.goal.reshape(-1, 3)
        via = np.broadcast_to(self._via, (len(start), *self._via.shape))
        planned = np.concatenate([start[:, None], via, goal[:, None]], axis=1)
        if rows is None:
            self._waypoints, self._steps = planned, np.zeros(len(start), dtype=np.int64)
        else:
            mask = np.reshape(rows, len(start)).astype(bool)
            self._waypoints[mask], self._steps[mask] = planned[mask], 0
        self.path = MinimumSnap(self._waypoints, chord_times(self._waypoints, self._duration))

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """The next action, with the signature of Stable-Baselines3's models.

        Args:
            observation: (…, D); only its leading shape is used.
            state: passed through.
            episode_start: (N,) booleans: rows whose episode starts with this call are planned anew.
            deterministic: has no effect.

        Returns:
            Actions (…, 4), and ``state``.
        """
        if episode_start is not None and np.any(episode_start):
            self.reset(episode_start)
        command = self._command()
        self._steps += 1
        leading = np.shape(observation)[:-1]
        return (command / self._scale).astype(np.float32).reshape(*leading, 4), state

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """The next action alone."""
        return self.predict(observation)[0]

    def _command(self) -> NDArray[np.float64]:
        flat, (wanted, snap) = self._plant.flat_state().reshape(-1, 4, 3), self._wanted()
        snap = snap + np.einsum("k,nki->ni", self._gains, wanted - flat)
        yaw_acceleration = -self._yaw_gain * self._plant.state.reshape(len(flat), -1)[:, OMEGA + 2]
        return np.column_stack([snap, yaw_acceleration])

    def _wanted(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where to be now, position to jerk (N, 4, 3), and the snap of the coming period (N, 3)."""
        if self._plant.follows:
            reference = self._plant.reference.reshape(-1, ORDERS, 3)
            return reference[:, :4], reference[:, 4]
        now, then = self.path.at(self._steps * self._period), self.path.at((self._steps + 1) * self._period)
        return now[:, :4], (then[:, 3] - now[:, 3]) / self._period


def chord_times(waypoints: ArrayLike, duration: float) -> NDArray[np.float64]:
    """Times that share a duration out in proportion to the straight distances between waypoints.

    Args:
        waypoints: (…, M + 1, 3), m.
        duration: s.

    Returns:
        (…, M + 1) s, from 0 to ``duration``.
    """
    points = finite_array("waypoints", waypoints, ("M + 1", 3))
    passed = np.cumsum(np.linalg.norm(np.diff(points, axis=-2), axis=-1), axis=-1)
    times = np.zeros(points.shape[:-1])
    # Of one segment the length does not matter: hovering at the goal takes the whole duration too.
    times[..., -1] = positive_number("duration", duration)
    if points.shape[-2] > 2:
        total = np.maximum(passed[..., -1:], np.finfo(np.float64).tiny)
        times[..., 1:-1] = duration * passed[..., :-1] / total
    return times


def _knot_derivatives(points: NDArray, times: NDArray) -> NDArray[np.float64]:
    """Derivatives 0 to 7 at the start of every segment, (M, 8, 3)."""
    spline = make_interp_spline(times, points, k=DEGREE, bc_type=(AT_REST, AT_REST))
    return np.stack([spline(times[:-1], nu=k) for k in range(DEGREE + 1)], axis=1)


def _taylor(derivatives: NDArray, since: NDArray) -> NDArray[np.float64]:
    """Derivatives 0 to 4 at ``since`` (…) after a point with derivatives (…, 8, 3)."""
    terms = since[..., None] ** np.arange(DEGREE + 1) / FACTORIALS
    return np.stack(
        [
            np.einsum("...k,...ki->...i", terms[..., : DEGREE + 1 - order], derivatives[..., order:, :])
            for order in range(ORDERS)
        ],
        axis=-2,
    )
