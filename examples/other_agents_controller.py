"""A hand-written PID controller behind the shield: straight at the goal, sphere or not."""

import gymnasium
import numpy as np

from shields import ShieldWrapper


def fly(scene: int) -> dict:
    env = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0"), margin=0.01)
    observation, info = env.reset(options={"scene": scene})
    integral, is_over = np.zeros(3), False
    while not is_over:
        error, rate = observation[:3], -observation[3:6]
        integral = np.clip(integral + 0.04 * error, -0.1, 0.1)
        action = 4.0 * error + 1.0 * integral + 0.5 * rate
        observation, _, terminated, truncated, info = env.step([*action, 0.0])
        is_over = terminated or truncated
    return info


if __name__ == "__main__":
    print(sum(fly(scene)["is_success"] for scene in range(100)), "of 100 scenes flown to the goal")
