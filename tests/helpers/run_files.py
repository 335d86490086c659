"""Files of a run as tests need them: tables, weights as one word, and a file that does harm when it is read."""

import csv
import hashlib
import os

import torch


def table(path):
    """Rows of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def weights(folder):
    """A digest of the weights of a training."""
    state = torch.load(folder / "policy.pt", weights_only=True)
    digest = hashlib.sha256()
    for name in sorted(state):
        digest.update(name.encode() + state[name].numpy().tobytes())
    return digest.hexdigest()


class Payload:
    """Makes a folder when unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)
