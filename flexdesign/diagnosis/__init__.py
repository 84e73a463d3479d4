"""Diagnosis: which physical effect a model lacks, judged by recorded runs."""

from flexdesign.diagnosis.procedure import diagnose
from flexdesign.diagnosis.result import Diagnosis, Named, Rung, Tried, Value

__all__ = ["Diagnosis", "Named", "Rung", "Tried", "Value", "diagnose"]
