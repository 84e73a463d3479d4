"""Diagnosis: which physical effect a model lacks, judged by recorded runs."""

from flexdesign.diagnosis.course import diagnose
from flexdesign.diagnosis.findings import Diagnosis, Named, Rung, Tried, Value

__all__ = ["Diagnosis", "Named", "Rung", "Tried", "Value", "diagnose"]
