"""The ways to filter a vehicle among spheres: sampled, sampled in a tube of errors, and (33) of the paper."""
