"""A shield in a plant's filter slot: what it did, what is told of it, whether it was surprised."""
