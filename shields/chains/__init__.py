"""Invariant sets of integrator chains in continuous time (Sections III to V of the paper)."""
