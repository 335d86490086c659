"""Stable-Baselines3 on the vector env: models, episodes, checkpoints."""
