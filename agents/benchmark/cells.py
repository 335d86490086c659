"""What the benchmark flies, as data: cells of task, action and conditions, and the methods in each."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

from agents.experiment.arms import IN_FRONT, arm_of
from agents.experiment.config import QUICK, Experiment, default_hyperparams

TASKS = {
    "avoid": "QuadSafe/Avoid-v0",
    "forest": "QuadSafe/Forest-v0",
    "rooms": "QuadSafe/Rooms-v0",
    "moving": "QuadSafe/Moving-v0",
}
ACTIONS = ("velocity", "snap")
CONDITIONS = ("none", "indoor")
# Over the defaults of PPO, the same in every cell. With 0.95 three times as many flights arrive in Forest and
# Moving after so many steps as with 0.99, and as many in Avoid and Rooms.
SOONER = {"ppo": {**QUICK, "gamma": 0.95}}
# Of some ten settings tried on one seed those with which SAC begins to arrive in Avoid, after 100,000 steps.
SOONER["sac"] = {"batch_size": 256, "gamma": 0.97, "learning_starts": 2000, "ent_coef": "auto_0.1"}
PLAIN = "none"  # the arm whose policies every filter is put in front of
# Methods without a filter, and what else learns behind one; a filter of a user is called by its module:Class.
ARM_OF_METHOD = {"ppo": PLAIN, "penalty": "collision-penalty", "lagrangian": "lagrangian", "sac": PLAIN}
FILTERS = {"sampled": "shield", **{name: name for name in ("cbf", "hocbf", "predictive", "geometric")}}
# Nothing but the policy bounds a snap: behind what is best with velocity commands vehicles become fast, the
# HOCBF-QP too fast for its box, and less is learned (docs/benchmark.md).
SLOW = {
    "sampled": "slow-shield",
    "hocbf": "agents.methods.hocbf_qp:SlowHocbf",
    "predictive": "agents.methods.predictive:SlowPredictive",
    "geometric": "agents.methods.geometric:SlowGeometric",
}
TUNED = {"velocity": FILTERS, "snap": {**FILTERS, **SLOW}}
METHODS = (*ARM_OF_METHOD, *FILTERS, *(f"ppo{IN_FRONT}{name}" for name in FILTERS))


@dataclass(frozen=True)
class Budget:
    """How much is flown for each method and seed."""

    timesteps: int = 400_000
    """Of PPO, with whatever stands around it."""
    off_policy_timesteps: int = 60_000
    """Of SAC, which learns at every one of them."""
    seeds: int = 10
    """From 0 on."""
    eval_episodes: int = 100
    """Held-out scenes."""


QUICK_BUDGET = Budget(timesteps=16_384, off_policy_timesteps=2_048, seeds=1, eval_episodes=10)


@dataclass(frozen=True)
class Method:
    """Who flies in a row of the table."""

    name: str
    action: str = "velocity"
    """What the policies command: for that a filter is tuned."""

    @property
    def filter(self) -> str:
        """The name of what filters its flights; "" for nothing."""
        last = self.name.rpartition(IN_FRONT)[2]
        return "" if last in ARM_OF_METHOD else last

    @property
    def arm(self) -> str:
        """Whose flights these are, see ``agents.experiment.arms``."""
        if not self.filter:
            return ARM_OF_METHOD[self.name]
        behind = TUNED[self.action].get(self.filter, self.filter)
        if IN_FRONT not in self.name:
            return behind
        # A policy that learned without the shield is flown with it in any run.
        return PLAIN if behind == "shield" else f"{PLAIN}{IN_FRONT}{behind}"

    @property
    def learner(self) -> str:
        """The arm that learned what flies."""
        return arm_of(self.arm).policies_of or self.arm

    @property
    def algo(self) -> str:
        """What learns."""
        return "sac" if self.name == "sac" else "ppo"


@dataclass(frozen=True)
class Cell:
    """A task with an action interface under conditions: in it methods are compared."""

    task: str
    action: str
    conditions: str

    @property
    def name(self) -> str:
        """As of a folder."""
        return f"{self.task}_{self.action}_{self.conditions}"

    def methods(self, names: Sequence[str]) -> list[Method]:
        """Those of the named methods that there are here: (33) takes one sphere, and is told of no errors."""
        has_cbf = (self.task, self.conditions) == ("avoid", "none")
        found = (Method(name, self.action) for name in names)
        return [method for method in found if has_cbf or method.filter != "cbf"]

    def experiment(self, algo: str, methods: Sequence[Method], budget: Budget) -> Experiment:
        """What is learned and flown in this cell with one algorithm."""
        arms = dict.fromkeys(arm for method in methods for arm in (method.learner, method.arm))
        told = {} if self.conditions == "none" else {"uncertainty": "conditions"}
        steps = budget.timesteps if algo == "ppo" else budget.off_policy_timesteps
        env = TASKS[self.task]
        return Experiment(
            env=env,
            action=self.action,
            env_kwargs={} if self.conditions == "none" else {"conditions": self.conditions},
            shield=told,
            arms=tuple(arms),
            algo=algo,
            hyperparams={**default_hyperparams(env, algo), **SOONER[algo]},
            n_timesteps=steps,
            n_seeds=budget.seeds,
            eval_episodes=budget.eval_episodes,
        )


def cells(tasks: Sequence[str], actions: Sequence[str], conditions: Sequence[str]) -> list[Cell]:
    """Every cell of these, in the order in which they are flown: the plain ones first."""
    return [Cell(t, a, c) for a, c, t in product(actions, conditions, tasks)]


def with_filters(names: Sequence[str], own: Sequence[str]) -> tuple[str, ...]:
    """The methods, and filters of a user both ways: learned behind, and put in front."""
    return (*names, *(f"{front}{name}" for name in own for front in ("", f"ppo{IN_FRONT}")))
