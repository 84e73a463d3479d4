"""A design as its author states it: dimensions, part or assembly, materials, and what a study of it asks."""
