"""Validation: from a design through solid, meshes and solves to FEM and formulas side by side."""

from flexdesign.validation.course import validate
from flexdesign.validation.cross_check import CrossCheck, Way
from flexdesign.validation.findings import Comparison, Validation
from flexdesign.validation.independent import IndependentCheck
from flexdesign.validation.made_by import provenance

__all__ = ["Comparison", "CrossCheck", "IndependentCheck", "Validation", "Way", "provenance", "validate"]
