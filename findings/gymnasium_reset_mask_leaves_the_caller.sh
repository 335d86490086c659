#!/usr/bin/env bash
# gymnasium 1.4.0: SyncVectorEnv.reset takes "reset_mask" out of the options of whoever calls it. A wrapper, or a
# training loop, that reads its own dictionary after the call finds no mask, and takes all rows for reset ones; used a
# second time, the same dictionary resets every row.
# Seen: 1.4.0, row 0 alone is reset at first; the key is gone afterwards; the second call with it resets both rows.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env" && "$folder/env/bin/pip" install --quiet "gymnasium==1.4.0" "numpy==2.2.6" || exit 2
"$folder/env/bin/python" - <<'PYTHON'
import gymnasium
import numpy as np


class Counter(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    resets = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.resets += 1
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 0.0, False, False, {}


mode = gymnasium.vector.AutoresetMode.DISABLED
env = gymnasium.vector.SyncVectorEnv([Counter, Counter], autoreset_mode=mode)
env.reset(seed=0)
options = {"reset_mask": np.array([True, False])}
env.reset(options=options)
first = [inner.resets for inner in env.envs]
is_gone = "reset_mask" not in options
env.reset(options=options)
second = [inner.resets for inner in env.envs]
print(gymnasium.__version__, "resets", first, "key gone", is_gone, "again", second)
raise SystemExit(0 if (first, is_gone, second) == ([2, 1], True, [3, 2]) else 1)
PYTHON
