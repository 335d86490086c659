"""Worlds that are looked at: frames, the path behind a vehicle, a window."""
