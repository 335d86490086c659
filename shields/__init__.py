"""Control-invariant sets of integrators, and the shield that keeps a quadrotor inside one."""

from shields.filtered import Filtered
from shields.shield import Shield
from shields.wrapper import ShieldWrapper, VectorShieldWrapper

__all__ = ["Filtered", "Shield", "ShieldWrapper", "VectorShieldWrapper"]
