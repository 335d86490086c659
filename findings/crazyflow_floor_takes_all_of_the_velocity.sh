#!/usr/bin/env bash
# crazyflow 0.4.0: a vehicle that gets below z = -0.001 m is put back there and loses its whole velocity, the horizontal
# one too: the world has a floor that every flight at z <= 0 sticks to, and no contact says so. A flight that is given
# around the origin stops at once. sim.step_pipeline has it as "clip_floor_pos".
# Seen: from 2 mm above at (1, 0, -1) m/s: after one step (0.999, 0, -1.018) m/s, after two (0, 0, 0).
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" install --quiet "crazyflow==0.4.0" || exit 2
cat > "$folder/look.py" <<'PYTHON'
import numpy as np
from crazyflow.sim import Sim

sim = Sim()
sim.reset()
states = sim.data.states
start = states.replace(
    pos=states.pos.at[...].set(np.array([0.0, 0.0, 0.002])),
    vel=states.vel.at[...].set(np.array([1.0, 0.0, -1.0])),
)
sim.data = sim.data.replace(states=start)
for _ in range(2):
    sim.step(1)
    print(np.asarray(sim.data.states.vel).ravel().round(3).tolist())
PYTHON
found=$(SCIPY_ARRAY_API=1 JAX_PLATFORMS=cpu "$folder/venv/bin/python" "$folder/look.py" 2>/dev/null | tail -2) || exit 1
printf '%s\n' "$found"
[ "$found" = "[0.9990000128746033, 0.0, -1.0180000066757202]
[0.0, 0.0, 0.0]" ]
