"""Worlds under conditions: what is drawn, what is flown of an answer, the true vehicle and its air."""
