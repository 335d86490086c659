#!/usr/bin/env bash
# sbx-rl 0.28.0: `get_parameters` of a model gives an empty dictionary, and `set_parameters` with `exact_match=True` takes
# it without a word. Its models are subclasses of Stable-Baselines3's `BaseAlgorithm`, of which the two are the documented
# way to carry weights from one model into another; who keeps checkpoints so goes on with fresh networks.
# Seen: two PPO of seeds 0 and 1; the second takes the parameters of the first, and acts as it did before, not as the first.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env" && "$folder/env/bin/pip" install --quiet "sbx-rl==0.28.0" "stable-baselines3==2.9.2" \
    "jax==0.10.2" "jaxlib==0.10.2" "gymnasium==1.4.0" "numpy==2.4.6" || exit 2
"$folder/env/bin/python" -W ignore - <<'PYTHON'
import numpy as np
from sbx import PPO

first, second = (PPO("MlpPolicy", "Pendulum-v1", seed=seed) for seed in (0, 1))
seen = np.array([0.5, 0.8, 3.0], dtype=np.float32)


def action(model):
    return float(model.predict(seen, deterministic=True)[0][0])


before, parameters = action(second), first.get_parameters()
second.set_parameters(parameters, exact_match=True)
print("parameters", parameters, "first", action(first), "second before", before, "and after", action(second))
raise SystemExit(0 if parameters == {} and action(second) == before != action(first) else 1)
PYTHON
