r"""A policy that sees no obstacle: straight at the goal. The film of the README is one of its flights:

python train.py watch examples.straight:policy --env QuadSafe/Forest-v0 --scene 1 --side-by-side \
    --render-size 360 --video docs/figures/flight.webp
"""


def policy(observation):
    """Velocity towards the goal, all of it beyond a quarter of its range: (4,) for an observation (D,)."""
    return [*(4.0 * observation[:3]).clip(-1.0, 1.0), 0.0]
