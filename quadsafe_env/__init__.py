"""A quadrotor that collides for real: (29) of the paper as a Gymnasium environment and a vector environment."""

from quadsafe_core.registration import register_environments
from quadsafe_env.conditions import CONDITIONS, Conditions

register_environments()

__all__ = ["CONDITIONS", "Conditions"]
