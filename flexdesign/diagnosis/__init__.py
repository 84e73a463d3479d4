"""Diagnosis: which physical effect a model lacks, judged by recorded runs."""

from flexdesign.diagnosis.procedure import diagnose
from flexdesign.diagnosis.result import CandidateRecord, Diagnosis, ErrorStep, IdentifiedEffect, Value

__all__ = ["CandidateRecord", "Diagnosis", "ErrorStep", "IdentifiedEffect", "Value", "diagnose"]
