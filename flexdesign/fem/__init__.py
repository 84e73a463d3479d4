"""From a part to its stiffness: domain, mesh, elasticity, ports, statics, modes, stress, section forces."""
