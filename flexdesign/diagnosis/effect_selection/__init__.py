"""The effects that a diagnosis tries, the estimation task it sets up for them, and conflicts with prior knowledge."""
