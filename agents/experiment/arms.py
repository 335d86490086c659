"""The arms of the comparison, as data."""

from dataclasses import dataclass, field
from typing import Any, Literal

AgentKind = Literal["learner", "tracker", "random", "given"]


@dataclass(frozen=True)
class Arm:
    """Who flies, and what stands around it while it learns.

    Whatever the arm, its flights are evaluated twice on the same held-out scenes: without a shield and with it.
    """

    title: str
    """What tables call it."""
    agent: AgentKind = "learner"
    """A policy that learns, the minimum-snap tracker of Section VI, uniformly random actions, or a policy from
    elsewhere that ``agents.evaluate`` was given."""
    is_shielded: bool = False
    """Whether the shield is there during training."""
    shield: dict[str, Any] = field(default_factory=dict)
    """Settings of the shield, over those of the experiment; in training and in evaluation."""
    collision_penalty: float = 0.0
    """Taken off the reward of a training step with a violation."""
    intervention_penalty: float = 0.0
    """Taken off the reward of a training step, times the share of it that the shield changed."""

    is_constrained: bool = False
    """Whether PPO learns under a limit on the mean cost of an episode, see ``agents.learn.lagrangian``."""

    @property
    def is_trained(self) -> bool:
        """Whether there is anything to learn."""
        return self.agent == "learner"

    @property
    def has_seeds(self) -> bool:
        """Whether a seed changes anything."""
        return self.agent not in ("tracker", "given")


# Of penalties from 0.5 to 10 and from 0.01 to 0.05, each tried with two seeds that no study flies, these left
# the fewest violations without the shield at no loss of success; larger ones for collisions make pilots timid.
ARMS = {
    "none": Arm("no shield"),
    "collision-penalty": Arm("collision penalty", collision_penalty=1.0),
    "shield": Arm("shield", is_shielded=True),
    "shield-penalty": Arm("shield, intervention penalty", is_shielded=True, intervention_penalty=0.05),
    "cbf": Arm("shield, method cbf", is_shielded=True, shield={"method": "cbf"}),
    "tracker": Arm("tracker", agent="tracker"),
    "random": Arm("random actions", agent="random"),
    "policy": Arm("given policy", agent="given"),
    "lagrangian": Arm("PPO-Lagrangian", is_constrained=True),
}
GIVEN = "policy"
OF_RUNS = tuple(name for name, arm in ARMS.items() if arm.agent != "given")
