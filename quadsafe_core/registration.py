"""The ids of the tasks, by name only: both islands register them, without importing each other."""

IDS = {
    "QuadSafe/Flight-v0": "flight",
    "QuadSafe/Avoid-v0": "avoid",
    "QuadSafe/Forest-v0": "forest",
    "QuadSafe/Rooms-v0": "rooms",
    "QuadSafe/Gates-v0": "gates",
    "QuadSafe/Track-v0": "track",
    "QuadSafe/Moving-v0": "moving",
}
# Time limits in policy steps: 12, 10, 16, 16, 24, 20 and 16 s at the default 25 Hz.
TIME_LIMITS = {
    "flight": 300,
    "avoid": 250,
    "forest": 400,
    "rooms": 400,
    "gates": 600,
    "track": 500,
    "moving": 400,
}


def register_environments() -> None:
    """Register the ids with Gymnasium, for ``gym.make`` and ``gym.make_vec``."""
    # A command line lists the ids before anything is loaded.
    import gymnasium

    for name, task in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                # The floor imports no island; Gymnasium does, when an environment is made.
                entry_point="quadsafe_env.env:QuadrotorEnv",
                vector_entry_point="quadsafe_env.vector_env:QuadrotorVectorEnv",
                max_episode_steps=TIME_LIMITS[task],
                kwargs={"task": task},
            )
