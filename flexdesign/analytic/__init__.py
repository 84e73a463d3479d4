"""Closed-form models of mechanisms: theory for comparison with finite elements and measurements."""
