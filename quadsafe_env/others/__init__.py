"""Worlds that plants of others fly: which was chosen, what a world asks of it, what it did."""
