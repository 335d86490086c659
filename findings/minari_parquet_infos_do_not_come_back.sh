#!/usr/bin/env bash
# Minari 0.5.4 with pyarrow 26.0.1: a data set that data_format="parquet" wrote without a word is not what is read. Infos of
# one number a step, a cost say, are written with an empty shape, and reading any episode then raises. Infos that are
# dictionaries come back as an array of dictionaries, one a step. From data_format="hdf5" both come back as they were.
# Seen: hdf5: shapes (4,) and {'snap': (4, 3)}; parquet: ValueError for the number; an object array (4,) for the dictionary.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" install --quiet "minari==0.5.4" "pyarrow==26.0.1" "h5py==3.16.0" "pillow==12.0.0" || exit 2
cat > "$folder/look.py" <<'PYTHON'
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
from minari import MinariDataset
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

box = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
steps = 3


def read_back(kind, infos):
    folder = Path(sys.argv[1]) / f"{kind}_{min(infos)}"
    flown = {
        "observations": np.zeros((steps + 1, 2), np.float32),
        "actions": np.zeros((steps, 2), np.float32),
        "rewards": np.zeros(steps),
        "terminations": np.zeros(steps, bool),
        "truncations": np.zeros(steps, bool),
        "infos": infos,
    }
    storage = MinariStorage.new(folder, observation_space=box, action_space=box, data_format=kind)
    storage.update_episodes([EpisodeBuffer(id=0, **flown)])
    storage.update_metadata({"dataset_id": "a/b-v0", "minari_version": "0.5.4"})
    try:
        infos = MinariDataset(folder)[0].infos
    except ValueError:
        return "ValueError"
    return {key: ({k: v.shape for k, v in of.items()} if isinstance(of, dict) else (of.shape, str(of.dtype))) for key, of in infos.items()}


for kind in ("hdf5", "parquet"):
    print(kind, read_back(kind, {"cost": np.arange(steps + 1.0)}), read_back(kind, {"shield": {"snap": np.ones((steps + 1, 3))}}))
PYTHON
found=$("$folder/venv/bin/python" -W ignore "$folder/look.py" "$folder") || exit 1
printf '%s\n' "$found"
[ "$found" = "hdf5 {'cost': ((4,), 'float64')} {'shield': {'snap': (4, 3)}}
parquet ValueError {'shield': ((4,), 'object')}" ]
