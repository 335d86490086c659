"""The parts of ``benchmarks/safety.py``: attacks, flights among many spheres, the bare chain, the results."""
