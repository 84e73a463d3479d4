"""Bodies condensed to their ports, assembled to a stage."""
