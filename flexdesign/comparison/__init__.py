"""Comparison of a stage model with recorded runs: by how much it fails, and where.

`where` takes the residuals of any model, and divides what they have above the noise floor; `compare` makes them.
"""

from flexdesign.comparison.by_line import ResponseComparison, by_band, joined
from flexdesign.comparison.compare import Comparison, RunComparison, compare
from flexdesign.comparison.where import Breakdown, Part, holds, where

__all__ = [
    "Breakdown",
    "Comparison",
    "Part",
    "ResponseComparison",
    "RunComparison",
    "by_band",
    "compare",
    "holds",
    "joined",
    "where",
]
