"""Ablation of the diagnosis: what its answers owe to each of its parts.

A part that can be switched off is a function whose result can be replaced by what it was given: a search of other local
minima by the fit as it is, an elimination by the model as it is. Cases of `studies.hidden_effect_trial` are diagnosed
as they are, and then without one part, where that part did anything. A part without which no answer changes is a
candidate for deletion::

    python -m studies.ablation --seed 7             # 90 fresh cases and 35 on imperfect benches: hours
    python -m studies.ablation --seed 7 --only escape

`parts.py` lists the parts. The study goes on where it stopped, while the package stays as it is; what comes of a seed
is in ``reports/ablation/seed-N``.
"""
