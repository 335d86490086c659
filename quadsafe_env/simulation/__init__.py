"""N quadrotors flown together: the world, its filter slot, and the kernels of a control period."""
