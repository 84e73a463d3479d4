"""Static tables: stiffness and amplification as a bench or a simulation gave them, and the model that predicts them.

A table has one measurement in each row, with its boundary and its uncertainty, and a column for each dimension in which
parts differ, so that a series of hinge thicknesses is one file.
"""

from flexdesign.analytic.static_model.model import StaticModel, nominal_effects, of_design
from flexdesign.analytic.static_model.uncertainty import Uncertainty, uncertainty
from flexdesign.measurements.static_table import Row, StaticTable, measurable, read, to_csv

__all__ = [
    "Row",
    "StaticModel",
    "StaticTable",
    "Uncertainty",
    "measurable",
    "nominal_effects",
    "of_design",
    "read",
    "to_csv",
    "uncertainty",
]
