"""Validation: from a design through solid, meshes and solves to FEM and formulas side by side."""

from flexdesign.workflows.validation.cross_check import CrossCheck, Way
from flexdesign.workflows.validation.independent_mesh import IndependentCheck
from flexdesign.workflows.validation.provenance import provenance
from flexdesign.workflows.validation.result import Comparison, Validation
from flexdesign.workflows.validation.validate_part import validate

__all__ = ["Comparison", "CrossCheck", "IndependentCheck", "Validation", "Way", "provenance", "validate"]
