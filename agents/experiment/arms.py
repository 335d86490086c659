"""The arms of the comparison, as data."""

from dataclasses import dataclass, field, replace
from typing import Any, Literal

AgentKind = Literal["learner", "tracker", "random", "given"]
# Between an arm and the one whose filter is put in front of its policies, as in "none+hocbf".
IN_FRONT = "+"


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
    filter: str = ""
    """A filter in the shield's place, in training and in evaluation, see ``agents.methods.wrapper``."""
    is_constrained: bool = False
    """Whether PPO learns under a limit on the mean cost of an episode, see ``agents.learn.lagrangian``."""
    policies_of: str = ""
    """The arm whose policies fly, where it learns nothing itself; they are flown with its filter only."""

    @property
    def is_trained(self) -> bool:
        """Whether there is anything to learn."""
        return self.agent == "learner" and not self.policies_of

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
    # Of six settings those behind which most is learned with snap commands, see benchmarks/snap_settings.py.
    "slow-shield": Arm("shield, for snap commands", is_shielded=True, shield={"alpha": 0.5, "snap_max": 60.0}),
    "tracker": Arm("tracker", agent="tracker"),
    "random": Arm("random actions", agent="random"),
    "policy": Arm("given policy", agent="given"),
    "lagrangian": Arm("PPO-Lagrangian", is_constrained=True),
    "hocbf": Arm("HOCBF-QP", is_shielded=True, filter="hocbf"),
    "predictive": Arm("predictive filter", is_shielded=True, filter="predictive"),
    "geometric": Arm("geometric backup", is_shielded=True, filter="geometric"),
}
GIVEN = "policy"
OF_RUNS = tuple(name for name, arm in ARMS.items() if arm.agent != "given")


def arm_of(name: str) -> Arm:
    """The arm of a name: of ``ARMS``; "module:Class", a filter of yours; or "A+B", the policies of A behind B.

    Raises:
        KeyError: for another name.
    """
    whose, plus, front = name.rpartition(IN_FRONT)
    if plus:
        learned, found = arm_of(whose), arm_of(front)
        title = f"{learned.title}, then {found.title}"
        return replace(found, title=title, is_shielded=False, policies_of=whose)
    if ":" in name:
        return Arm(name, is_shielded=True, filter=name)
    return ARMS[name]


def is_arm(name: str) -> bool:
    """Whether there is an arm of this name; one in front of which something is put must learn."""
    whose, plus, front = name.rpartition(IN_FRONT)
    if plus:
        return is_arm(whose) and is_arm(front) and arm_of(whose).is_trained and arm_of(front).is_shielded
    return ":" in name or name in ARMS
