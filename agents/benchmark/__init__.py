"""Every method on the same quadrotor: what is flown, its table and its picture."""
