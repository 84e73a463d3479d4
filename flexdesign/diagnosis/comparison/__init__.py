"""Comparison of a stage model with recorded runs: by how much it fails, and where.

`where` takes the residuals of any model, and divides what they have above the noise floor.
"""

from flexdesign.diagnosis.comparison.compare import Comparison, RunComparison
from flexdesign.diagnosis.comparison.error_location import Breakdown, Part, where
from flexdesign.diagnosis.comparison.frequency_response import ResponseComparison, by_band, join_halves

__all__ = [
    "Breakdown",
    "Comparison",
    "Part",
    "ResponseComparison",
    "RunComparison",
    "by_band",
    "join_halves",
    "where",
]
