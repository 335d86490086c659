"""Flights of the bare chain under errors."""
