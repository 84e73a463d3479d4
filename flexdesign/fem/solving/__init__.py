"""Elasticity on a mesh: stiffness, ports, statics, modes, large displacements."""
