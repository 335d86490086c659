"""The three rates of a world."""

from typing import NamedTuple

from quadsafe_core.checks import positive_integer


class Rates(NamedTuple):
    """Policy, control and physics rates, Hz; each divides the next."""

    policy: int
    control: int
    physics: int


def check_rates(rates: Rates) -> None:
    """Each rate a positive integer that divides the next.

    Raises:
        ValueError: naming the rate that does not fit.
    """
    for name, value in zip(rates._fields, rates, strict=True):
        positive_integer(f"{name}_hz", value)
    if rates.control % rates.policy:
        raise ValueError(f"policy_hz must divide control_hz, got {rates.policy} and {rates.control}")
    if rates.physics % rates.control:
        raise ValueError(f"control_hz must divide physics_hz, got {rates.control} and {rates.physics}")
