"""The C shield behind ctypes, built with the system's compiler, rows at a time."""

import ctypes
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from house import ROOT

from quadsafe_core.shapes.cores import cores_of
from shields.methods.memory import sampled_memory, stops_of
from shields.settings.uncertainty import Uncertainty

if shutil.which("cc") is None:
    pytest.skip("there is no C compiler, cc", allow_module_level=True)

SOURCE = ROOT / "tests" / "c" / "loops.c"
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off", "-O2")
(
    DONE,
    BAD_POINTER,
    BAD_SETTINGS,
    BAD_UNCERTAINTY,
    BAD_PERIOD,
    BAD_COUNT,
    BAD_STATE,
    BAD_OBSTACLE,
    BAD_TIME,
    TOO_LARGE,
) = range(10)
KINDS = ("invalid", "sphere", "capsule", "cylinder", "box", "hull", "half_space")
# Kinds of ``quadsafe_core.shapes.cores`` in the order of those here.
CORE_KINDS = (None, 1, 2, 3, 4, 5, 7)


def types_of(real):
    """The records of quadsafe.h."""
    uncertainty = np.dtype(
        [(name, real) for name in Uncertainty._fields[:7]]
        + [("delay", "i4"), ("losses", "i4"), ("rotor_lag", real), ("rotor_lag_most", real)]
        + [(name, real) for name in Uncertainty._fields[10:]],
        align=True,
    )
    numbers = (
        "snap_max reserve held_snap_max jerk_max alpha margin specific_thrust_min specific_thrust_max gravity"
    )
    settings = np.dtype([*((name, real) for name in numbers.split()), ("uncertainty", uncertainty)], align=True)
    obstacle = np.dtype(
        [
            ("kind", "i4"),
            ("center", real, (3,)),
            ("velocity", real, (3,)),
            ("radius", real),
            ("axes", real, (3, 3)),
            ("half", real, (3,)),
            ("points", "u8"),
            ("count", "i4"),
        ],
        align=True,
    )
    answer = np.dtype(
        [
            ("snap", real, (3,)),
            ("certified", "i4"),
            ("intervened", "i4"),
            ("correction", real),
            ("value", real),
            ("reserve", real),
            *((name, "i4") for name in ("obstacle", "in_set", "fallback", "refused", "stopped")),
        ],
        align=True,
    )
    return settings, obstacle, answer


def build(*flags, source=SOURCE, is_float=False):
    """The path of a shared library of the C shield, compiled without a warning."""
    folder = Path(tempfile.mkdtemp(prefix="quadsafe_c_"))
    out = folder / "loops.so"
    wide = ("-DQS_FLOAT", "-Wdouble-promotion") if is_float else ()
    command = ["cc", *FLAGS, *wide, *flags, "-shared", "-fPIC", str(source)]
    subprocess.run([*command, "-o", str(out), "-lm"], check=True)
    return out


def library(is_float=False):
    """The built library, once a process."""
    return _library(is_float)


@functools.cache
def _library(is_float):
    return Library(build(is_float=is_float), is_float)


class Library:
    """Calls of the C shield with arrays."""

    def __init__(self, path, is_float=False):
        self.c, self.real = ctypes.CDLL(str(path)), np.dtype("f4" if is_float else "f8")
        self.number = ctypes.c_float if is_float else ctypes.c_double
        self.settings, self.obstacle, self.answer = types_of(self.real)
        for name in ("settings", "obstacle", "answer"):
            assert getattr(self, name).itemsize == getattr(self.c, f"size_of_{name}")(), name

    def call(self, name, *arguments):
        """A function with arrays as pointers and floats as qs_real."""
        getattr(self.c, name)(*(self._passed(a) for a in arguments))

    def _passed(self, a):
        if isinstance(a, np.ndarray):
            assert a.flags.c_contiguous
            return ctypes.c_void_p(a.ctypes.data)
        return self.number(a) if isinstance(a, float) else a

    def reals(self, values):
        """An array of qs_real in C order."""
        return np.ascontiguousarray(values, dtype=self.real)

    def body(self, maker, *arguments):
        """An obstacle, by the function that makes its kind; arrays, floats, None for NULL."""
        function = getattr(self.c, f"qs_{maker}")
        raw = np.zeros((), dtype=self.obstacle)

        class Raw(ctypes.Structure):
            _fields_ = [("bytes", ctypes.c_uint64 * (self.obstacle.itemsize // 8))]

        function.restype = Raw
        kept = [self.reals(a) if isinstance(a, (list, tuple, np.ndarray)) else a for a in arguments]
        raw[...] = np.frombuffer(bytes(function(*(self._passed(a) for a in kept))), dtype=self.obstacle)[0]
        return raw

    def worlds(self, obstacles):
        """Records (N, K) of ``Obstacles`` of N worlds, number for number, none a hull."""
        n, k = obstacles.radius.shape
        found = np.zeros((n, k), dtype=self.obstacle)
        found["kind"], found["axes"] = KINDS.index("sphere"), np.eye(3)
        found["center"], found["radius"] = obstacles.center, obstacles.radius
        if obstacles.velocity is not None:
            found["velocity"] = obstacles.velocity
        if obstacles.cores is not None:
            core = cores_of(obstacles.cores, n, k).core
            found["kind"] = np.array([CORE_KINDS.index(kind) for kind in core["kind"].ravel()]).reshape(n, k)
            found["axes"], found["half"] = core["axes"], core["half"]
        return found


def made_in_c(shape, found=None):
    """A shape by the function of its kind, and for a hull the points that have to stay."""
    found = found or library()
    arguments = {
        "sphere": lambda s: (s.center, s.radius, None),
        "capsule": lambda s: (s.start, s.end, s.radius, None),
        "cylinder": lambda s: (s.start, s.end, s.radius, None),
        "box": lambda s: (s.center, s.size, None if s.rotation is None else np.ravel(s.rotation), None),
        "half_space": lambda s: (s.normal, s.offset),
        "hull": lambda s: (kept(s.points, found), len(s.points), s.radius, None),
    }
    return found.body(shape.name, *arguments[shape.name](shape))


KEPT = []


def kept(points, found):
    """Points that stay where they are: a hull in C keeps the pointer."""
    KEPT.append(found.reals(points))
    return KEPT[-1]


class CShields:
    """N shields in C with the settings of a ``Shield`` of Python, flown together.

    ``exactly``: the numbers that Python makes with numpy's linear algebra are taken from there, so that what is
    made of them can be compared bit for bit.
    """

    def __init__(self, library, shield, n):
        self.library, self.n = library, n
        size = library.c.size_of_shield()
        self.memory, self.codes = np.zeros(n * size, dtype=np.uint8), np.zeros(n, dtype=np.int32)
        self.settings = settings_in(library, shield)
        library.call("init_rows", n, self.memory, self.settings, self.codes)

    def prepare(self, period):
        """What a new period needs."""
        self.library.call("prepare_rows", self.n, self.memory, float(period), self.codes)
        return self.codes

    def exactly(self, shield, period):
        """Take over the numbers of a shield that has filtered at that period."""
        self.library.call("take_gains", self.n, self.memory, self.library.reals(gains_of(shield)))

    def filter(self, flats, obstacles, snaps, period):
        """Answers and codes."""
        answers = np.zeros(self.n, dtype=self.library.answer)
        flats, snaps = self.library.reals(flats), self.library.reals(snaps)
        count, codes = obstacles.shape[1], np.zeros(self.n, dtype=np.int32)
        self.library.call(
            "filter_rows", self.n, count, self.memory, flats, obstacles, snaps, float(period), answers, codes
        )
        return answers, codes

    def held_for(self, seconds):
        """For how long (N,) the last answers were held; codes."""
        codes = np.zeros(self.n, dtype=np.int32)
        self.library.call("held_rows", self.n, self.memory, self.library.reals(seconds), codes)
        return codes

    def backup(self, mask):
        """Snaps (N, 3), 0 where it is not asked."""
        out = np.zeros((self.n, 3), dtype=self.library.real)
        self.library.call("backup_rows", self.n, self.memory, mask.astype(np.int32), out)
        return out


def settings_in(library, shield):
    """The settings of a ``Shield`` as a record."""
    found, given = np.zeros((), dtype=library.settings), shield.settings
    for name in found.dtype.names:
        if name != "uncertainty":
            found[name] = np.inf if given[name] is None else given[name]
    told = found["uncertainty"]
    for name, bound in (given["uncertainty"] or {}).items():
        if isinstance(bound, tuple):
            told["rotor_lag"], told["rotor_lag_most"] = bound
        else:
            told[name] = bound
    return found


def gains_of(shield):
    """What a ``Shield`` that has filtered counts with, in the order of ``gains_of`` of the C loops."""
    s = sampled_memory(shield._method.memory, *shield._size, stops_of(getattr(shield._method, "_mark", None)))[
        0
    ].settings[0]
    rows = [s[name] for name in ("tracking", "braking", "recovery", "easing")]
    names = "easing_left easing_within gamma u_max input_max snap_max stop_snap_max jerk_max"
    rest = [s[name] for name in (*names.split(), "specific_thrust_min", "specific_thrust_max")]
    has_tube = shield.settings["uncertainty"] is not None
    return np.concatenate([*rows, rest, s["tube"] if has_tube else (0.0, 0.0)])


def differences(answer, filtered):
    """The rows in which an answer in C differs from that of Python in a bit of any field."""
    differs = np.zeros(len(answer), dtype=bool)
    for name in answer.dtype.names:
        mine, other = answer[name], np.asarray(getattr(filtered, name))
        is_other = (mine != other) & ~(np.isnan(mine) & np.isnan(other))
        differs |= is_other.any(axis=-1) if is_other.ndim > 1 else is_other
    return np.flatnonzero(differs)
