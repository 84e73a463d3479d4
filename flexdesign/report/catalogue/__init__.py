"""Pages of the catalogue: effects, static effects, materials."""
