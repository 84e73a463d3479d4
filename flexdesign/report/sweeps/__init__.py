"""Reports of sweeps, optimisation and sizing."""
