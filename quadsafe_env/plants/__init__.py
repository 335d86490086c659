"""Plants that others wrote behind one protocol: adapters, the loop on board, the loop around them."""

from quadsafe_env.plants.flights import Flight, fly
from quadsafe_env.plants.plant import Plant, make_plant

__all__ = ["Flight", "Plant", "fly", "make_plant"]
