"""Filters that others would put in the shield's place, behind the same door."""
