"""Reports of simulated experiments."""
