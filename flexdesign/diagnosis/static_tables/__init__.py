"""Fit and diagnosis of static tables: stiffness, amplification and stroke of a part at rest."""
