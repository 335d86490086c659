"""Sixteen vehicles side by side, where nothing has to be corrected."""
