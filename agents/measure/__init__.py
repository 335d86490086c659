"""Held-out flights and their numbers: evaluation, results, statistics, provenance."""
