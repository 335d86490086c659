"""Filters that keep a chain in its set: inputs held for a period, and boxes in continuous time."""
