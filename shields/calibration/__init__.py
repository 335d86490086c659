"""What to declare of a plant, measured: excitations, what a lag leaves of them, a bound and its check."""
