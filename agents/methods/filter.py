"""What every filter of this room is: the same door to the slot, and the same book-keeping."""

import math
from array import array
from collections.abc import Mapping
from time import perf_counter_ns
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.methods.halfspaces import Bodies, Floats, bodies_of, clearance_batch
from quadsafe_core.checks import non_negative_number
from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from shields.interface.filtered import NUMBERS, Filtered
from shields.interface.row_checks import BRAKING_POLE
from shields.settings.chain import chain_over


class Vehicle(NamedTuple):
    """What a filter may ask of a vehicle: the numbers that the sampled shield counts on."""

    held_snap: float
    """Longest snap that may be commanded, m/s⁴; that of a stop where no other is told."""
    jerk_max: float
    """m/s³."""
    least_thrust: float
    """Specific thrust, m/s²."""
    most_thrust: float
    """Specific thrust, m/s²."""
    gravity: float
    """m/s²."""


class Answer(NamedTuple):
    """What a filter wants of a row."""

    snap: Floats
    """(3,), m/s⁴."""
    failed: bool = False
    """Whether its solver gave no answer, and something else is flown."""


class Answers(NamedTuple):
    """What a filter wants of M rows."""

    snap: Floats
    """(M, 3), m/s⁴."""
    failed: NDArray[np.bool_]
    """(M,), see ``Answer``."""


class Filter:
    """A filter in the slot of a plant, told of as the shield is: see ``shields.slot.recorded``.

    A desired snap that is not finite is answered by braking, filtered. ``fallback`` is a call whose solver
    failed, or whose desired snap was not finite; ``certified`` is always False; ``value`` is the distance from
    the nearest body, less what is to be kept, m.

    Of an ``uncertainty`` in the settings two numbers are used. Behind a ``delay`` of d periods the filter
    answers for the state in d periods, which the chain reaches under the answers on their way. The bound of
    ``position`` is added to the margin.

    Args:
        settings: of a ``Shield`` for the same plant, whose limits of a flight are this filter's.
        margin: kept beyond every keep-out distance, m.
    """

    can_lose = False

    def __init__(self, settings: Mapping[str, Any], margin: float = 0.0):
        self.settings, self.vehicle = dict(settings), vehicle_of(settings)
        declared = settings["uncertainty"]
        self.delay = 0 if declared is None else int(declared["delay"])
        known = 0.0 if declared is None else declared["position"]
        self.margin = non_negative_number("margin", margin) + known
        self._sent = np.zeros((0, self.delay, 3))
        self.calls, self.solver_calls, self.solver_failures = 0, 0, 0
        self._nanoseconds = array("q")

    def answer(self, row: int, flat: Floats, bodies: Bodies, snap: Floats) -> Answer:
        """The answer to one row that was not let through: state (4, 3), desired snap (3,).

        A filter has this, or ``answers``.
        """
        raise NotImplementedError(f"{type(self).__name__} has neither answer nor answers")

    def passes(self, flat: Floats, bodies: Bodies, snap: Floats, period: float) -> NDArray[np.bool_]:
        """Rows whose desired snap is the answer, (N,), for states (N, 4, 3); none if a filter does not say."""
        return np.zeros(len(flat), dtype=np.bool_)

    def answers(self, rows: NDArray[np.intp], flat: Floats, bodies: Bodies, snap: Floats) -> Answers:
        """The answers to the rows (M,) that were not let through, of states (N, 4, 3), desired snaps (N, 3)."""
        found = Answers(np.empty((len(rows), 3)), np.zeros(len(rows), dtype=np.bool_))
        for i, row in enumerate(rows.tolist()):
            began = perf_counter_ns()
            found.snap[i], found.failed[i] = self.answer(row, flat[row], bodies, snap[row])
            self._note(perf_counter_ns() - began, found.failed[i : i + 1])
        return found

    @property
    def microseconds_per_call(self) -> float | None:
        """Median of the time that a row took of a solver, all around it included; None before the first."""
        return float(np.median(self._nanoseconds)) / 1000.0 if self._nanoseconds else None

    def counts(self) -> dict[str, float | None]:
        """Rows answered, for how many a solver was asked, how many had no solution, and its median time.

        A row without a solution counts, whoever found that there is none.
        """
        return {
            "calls": self.calls,
            "solver_calls": self.solver_calls,
            "solver_failures": self.solver_failures,
            "microseconds_per_call": self.microseconds_per_call,
        }

    def filter(self, flat: Floats, obstacles: Obstacles, snap: Floats, period: float) -> Filtered:
        """The answers to N rows, see ``shields.Shield.filter``.

        Raises:
            ValueError: for measurements that are not finite.
        """
        if not (np.isfinite(flat).all() and np.isfinite(obstacles.center).all()):
            raise ValueError("flat and obstacles must be finite, got others")
        if len(self._sent) != len(flat):
            self._sent = np.zeros((len(flat), self.delay, 3))
        flat = self._ahead(flat, period)
        bodies = bodies_of(obstacles, self.delay * period)
        is_finite = np.logical_and.reduce(np.isfinite(snap), axis=1)
        wanted = snap if is_finite.all() else np.where(is_finite[:, None], snap, braking(flat, period))
        filtered = Filtered(np.zeros(NUMBERS * len(flat)), (len(flat),))
        filtered.snap[:], facts = wanted, filtered.facts
        facts["fallback"] = ~is_finite
        self.calls += len(flat)
        rows = np.flatnonzero(~self.passes(flat, bodies, wanted, period))
        filtered.snap[rows], failed = self.answers(rows, flat, bodies, wanted)
        facts["fallback"][rows] = failed | ~is_finite[rows]
        self._tell(facts, flat, bodies, filtered.snap - wanted)
        self._sent = np.concatenate([self._sent, filtered.snap[:, None]], axis=1)[:, 1:]
        return filtered

    def _ahead(self, flat: Floats, period: float) -> Floats:
        """The states when an answer that is given now is flown."""
        step, added = chain_over(period)
        for i in range(self.delay):
            flat = np.einsum("op,npi->noi", step, flat) + added[:, None] * self._sent[:, i : i + 1]
        return flat

    def _note(self, nanoseconds: int, failed: NDArray[np.bool_]) -> None:
        """Count rows (M,) that were answered together in a time, and what failed of them."""
        self._nanoseconds.extend([nanoseconds // len(failed)] * len(failed))
        self.solver_calls += len(failed)
        self.solver_failures += int(failed.sum())

    def _tell(self, facts: NDArray[np.void], flat: Floats, bodies: Bodies, change: Floats) -> None:
        facts["correction"], facts["intervened"] = np.linalg.norm(change, axis=1), change.any(axis=1)
        value, obstacle = np.empty(len(flat)), np.empty(len(flat))
        clearance_batch(bodies, flat[:, 0], value, obstacle)
        facts["value"], facts["obstacle"] = value, obstacle
        facts["in_set"] = facts["value"] >= 0.0
        facts["obstacle"][facts["intervened"] == 0.0] = -1.0

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget rows, or everything."""
        if mask is None:
            self._sent = np.zeros((0, self.delay, 3))
        elif len(self._sent):
            self._sent[mask] = 0.0

    def override(self, mask: NDArray[np.bool_], snaps: Floats) -> None:
        """Rows fly other snaps than were answered."""
        self.reset(mask)
        if self.delay:
            self._sent[mask, -1] = snaps

    def backup(self, mask: NDArray[np.bool_]) -> Floats:
        """There is none to ask for."""
        raise ValueError("a filter of agents.methods has no backup for lost answers, got a call for one")

    def held_for(self, seconds: Floats) -> None:
        """Times of held answers are not used."""

    def snapshot(self) -> dict[str, NDArray]:
        """All that it remembers, as copies, for ``restore``; times are not of it."""
        counts = np.array([self.calls, self.solver_calls, self.solver_failures])
        return {"counts": counts, "sent": self._sent.copy()}

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """Go on where an equal filter was when it gave this snapshot."""
        self.calls, self.solver_calls, self.solver_failures = map(int, snapshot["counts"])
        self._sent = snapshot["sent"].copy()


def vehicle_of(settings: Mapping[str, Any]) -> Vehicle:
    """The limits of a flight in the settings of a ``Shield``, those of its authority where it has one."""
    own = settings["authority"]
    if own is not None:
        names = ("snap_max", "jerk_max", "specific_thrust_min", "specific_thrust_max", "gravity")
        return Vehicle(*(own[name] for name in names))
    held, jerk, most = (settings[name] for name in ("held_snap_max", "jerk_max", "specific_thrust_max"))
    return Vehicle(
        settings["snap_max"] * settings["reserve"] if held is None else held,
        math.inf if jerk is None else jerk,
        settings["specific_thrust_min"],
        math.inf if most is None else most,
        settings["gravity"],
    )


def braking(flat: Floats, period: float) -> Floats:
    """Snaps (N, 3) that bring v, a and j to zero, as the shield's answer to a snap that is not finite."""
    return -np.einsum("o,noi->ni", held_gains(3, BRAKING_POLE, period), flat[:, 1:])
