"""Policies from elsewhere: as agents, evaluated like those of a run, filmed, and written for other programs."""
