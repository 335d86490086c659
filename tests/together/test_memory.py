"""What shielded rows weigh, as docs/speed.md has it."""

import gc
import subprocess
import sys
import tracemalloc

import gymnasium
import numpy as np
import pytest

from shields import VectorShieldWrapper

# Of a row among one sphere, and what each further sphere adds.
ROW, SPHERE = 724, 72
# Rows that are reset in a step, and the heads of arrays.
SLACK = 4
MANY = """
import sys
import gymnasium, numpy as np
from shields import VectorShieldWrapper
n, rng = int(sys.argv[1]), np.random.default_rng(0)
env = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Avoid-v0", n))
env.reset(seed=0)
for _ in range(2):
    env.step(rng.uniform(-1, 1, (n, 4)).astype(np.float32))
with open("/proc/self/status") as status:
    print(next(line.split()[1] for line in status if line.startswith("VmHWM")))
"""


def held(rows, spheres):
    """Bytes that a shielded vector env holds once it has flown."""
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    env = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Forest-v0", rows, sphere_count=spheres))
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.zeros((rows, 4), dtype=np.float32))
    gc.collect()
    return tracemalloc.get_traced_memory()[0] - before


def test_a_shielded_row_and_a_further_sphere_weigh_what_is_said():
    held(16, 1)
    tracemalloc.start()
    try:
        small, large, crowded = held(512, 1), held(2_048, 1), held(2_048, 5)
    finally:
        tracemalloc.stop()
    row, sphere = (large - small) / 1_536, (crowded - large) / 4 / 2_048
    # As much less would be as wrong: then the numbers of the page are old.
    assert ROW - 16 < row < ROW + SLACK
    assert SPHERE - 4 < sphere < SPHERE + SLACK


def test_bounds_of_the_spaces_are_those_of_one_row():
    env = gymnasium.make_vec("QuadSafe/Avoid-v0", 1_000)
    for space in (env.observation_space, env.action_space):
        assert isinstance(space, gymnasium.spaces.Box)
        assert space.low.strides[0] == space.high.strides[0] == 0
        assert space.contains(space.sample())
        assert not space.contains(space.sample() + 3.0)


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc is Linux's")
def test_a_quarter_of_a_million_shielded_rows_fly_in_a_gibibyte():
    # The first compiles, which takes half a gibibyte of its own. ru_maxrss would count who asks, too.
    found = [
        subprocess.run([sys.executable, "-c", MANY, str(n)], capture_output=True, text=True, check=True)
        for n in (16, 262_144)
    ]
    assert int(found[1].stdout) < 1_024 * 1_024
