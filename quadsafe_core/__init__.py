"""The floor both islands stand on: the kernel decorator, argument checks, three-vectors as floats."""
