"""The ids of the tasks; the floor has them, so that they are known wherever it is."""

from quadsafe_core.registration import IDS, TIME_LIMITS, register_environments

__all__ = ["IDS", "TIME_LIMITS", "register_environments"]
