"""Round trips: an effect is simulated at the strength of the catalogue, and its recordings are diagnosed."""
