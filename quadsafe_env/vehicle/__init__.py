"""One quadrotor: its parameters, state, equations of motion, rotors, flat map, commands and inner loop."""
