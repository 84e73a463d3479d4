"""Sensitivity of the diagnosis: what its answers owe to each of its decision constants.

A constant was chosen; here cases of `studies.hidden_effect_trial` are diagnosed with it at half and at twice its value,
and as it is. An answer that depends on a factor of two of a constant is no finding::

    python -m studies.sensitivity                     # twelve fresh cases, every constant: hours
    python -m studies.sensitivity --seed 7 --cases 60 # the same cases again, or more of them
    python -m studies.sensitivity --only criterion.LARGE

`constants.py` lists the constants. The study goes on where it stopped, while the package stays as it is; what comes of
a seed is in ``reports/sensitivity/seed-N``.
"""
