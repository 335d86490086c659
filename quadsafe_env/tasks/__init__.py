"""Where a quadrotor flies, what it is paid for, and what it meets: scenes, bodies, rewards, conditions."""
