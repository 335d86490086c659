"""The stored stop: a manoeuvre to rest, the proof that it is clear, and the way out where there is none."""
