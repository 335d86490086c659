#!/usr/bin/env bash
# gymnasium 1.3.0: around a vector env that resets in the same step, the vector RecordEpisodeStatistics counts the
# first episode right and every later one a step too short: it takes the step after an end for a reset, as in the mode
# NEXT_STEP. Returns lose the reward of that step as well. 1.4.0 counts right.
# Seen: episodes of 4 steps, of length 4, 3, 3 with 1.3.0; 4, 4, 4 with 1.4.0.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
for version in 1.3.0 1.4.0; do
  python3 -m venv "$folder/$version" && "$folder/$version/bin/pip" install --quiet "gymnasium==$version" "numpy==2.2.6" || exit 2
done
cat > "$folder/count.py" <<'PYTHON'
import gymnasium
import numpy as np
from gymnasium.wrappers.vector import RecordEpisodeStatistics


class Four(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.age = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.age += 1
        return np.zeros(1, np.float32), 1.0, self.age == 4, False, {}


mode = gymnasium.vector.AutoresetMode.SAME_STEP
env = RecordEpisodeStatistics(gymnasium.vector.SyncVectorEnv([Four], autoreset_mode=mode))
env.reset(seed=0)
lengths = []
for _ in range(12):
    info = env.step(np.zeros((1, 1), np.float32))[4]
    for place in (info, info.get("final_info", {})):
        if "episode" in place:
            lengths.append(int(place["episode"]["l"][0]))
            break
print(gymnasium.__version__, lengths)
PYTHON
old=$("$folder/1.3.0/bin/python" "$folder/count.py") && new=$("$folder/1.4.0/bin/python" "$folder/count.py") || exit 1
printf '%s\n%s\n' "$old" "$new"
[ "$old" = "1.3.0 [4, 3, 3]" ] && [ "$new" = "1.4.0 [4, 4, 4]" ]
