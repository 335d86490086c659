"""Clone the flights of a run, and fly the clone without and with the shield.

python train.py --arms shield -n 300000
python train.py export logs/QuadSafe-Avoid-v0_1 --format minari -o flights
python examples/offline.py flights
"""

import argparse
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import torch

import agents
from agents.policies.minari_file import read_flights


def cloned(observations: np.ndarray, actions: np.ndarray, steps: int) -> torch.nn.Module:
    """A network that gives these actions for these observations, in the least squares, by Adam."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    hidden = [
        torch.nn.Linear(observations.shape[1], 64),
        torch.nn.Tanh(),
        torch.nn.Linear(64, 64),
        torch.nn.Tanh(),
    ]
    network = torch.nn.Sequential(*hidden, torch.nn.Linear(64, actions.shape[1]))
    optimiser = torch.optim.Adam(network.parameters(), 2e-3)
    given, wanted = torch.as_tensor(observations), torch.as_tensor(actions)
    for _ in range(steps):
        rows = torch.randint(len(given), (512,))
        loss = torch.nn.functional.mse_loss(network(given[rows]), wanted[rows])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return network


class Clone:
    """What ``agents.evaluate`` flies many scenes of at once."""

    def __init__(self, network: torch.nn.Module):
        self._network = network

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Actions (N, 4) of observations (N, D)."""
        with torch.no_grad():
            actions = self._network(torch.as_tensor(observation)).numpy()
        return np.clip(actions, -1.0, 1.0), None


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flights", type=Path)
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--scenes", type=int, default=200)
    options = parser.parse_args()
    flights = read_flights(options.flights)
    episodes = list(flights)
    network = cloned(
        np.concatenate([episode.observations[:-1] for episode in episodes]),
        np.concatenate([episode.actions for episode in episodes]),
        options.steps,
    )

    # Scenes that are not in the data.
    scenes = range(2**62, 2**62 + options.scenes)
    # The shield that the flights had is put around it there.
    env = gymnasium.make(replace(flights.spec.env_spec, additional_wrappers=()))
    print(agents.evaluate(Clone(network), env, list(scenes)))
