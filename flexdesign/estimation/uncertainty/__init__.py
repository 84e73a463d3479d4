"""Covariance, profile likelihood, confidence intervals, identifiability."""
