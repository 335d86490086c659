"""The floor both islands stand on: compiled kernels, mathematics, argument checks, what a vehicle can give."""

from quadsafe_core.old_paths import keep_old_paths

keep_old_paths(__name__, {"quadsafe_core.kernels": "vec3", "quadsafe_core.maths": "feedback"})
