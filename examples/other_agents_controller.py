"""A hand-written controller behind the shield: straight at the goal, sphere or not."""

import gymnasium

from shields import ShieldWrapper


def fly(scene: int) -> dict:
    env = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0"), margin=0.01)
    observation, info = env.reset(options={"scene": scene})
    is_over = False
    while not is_over:
        observation, _, terminated, truncated, info = env.step([*(3.0 * observation[:3]), 0.0])
        is_over = terminated or truncated
    return info


if __name__ == "__main__":
    print(sum(fly(scene)["is_success"] for scene in range(100)), "of 100 scenes flown to the goal")
