"""A quadrotor that collides for real: (29) of the paper as a Gymnasium environment and a vector environment."""

from quadsafe_env.conditions import CONDITIONS, Conditions
from quadsafe_env.registration import register_environments

register_environments()

__all__ = ["CONDITIONS", "Conditions"]
