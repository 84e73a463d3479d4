"""Effects of which none alone explains a certain share, added together.

Where much is missing at once, the residual of a model with one further effect is so large and so correlated that the
fall of chi^2 may be chance. Effects are therefore added one after the other without being asked for evidence, and then
those are dropped, one by one, that have none given the others (forward selection and backward elimination: Miller,
Subset Selection in Regression, 2002, section 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence

from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, refit
from flexdesign.estimation.model_selection.model_comparison import Step, compare, rank
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.stepwise_selection import forward


def add_together(task: EstimationTask, fit: FittedModel, candidates: Sequence[Candidate], most: int) -> Step | None:
    """Return a step that adds several effects, each with evidence given the others; None where there is none.

    Parameters
    ----------
    task, fit
        The runs, and the fit from which it starts.
    candidates
        The catalogue.
    most
        Largest number of effects, those of the fit included.
    """
    full, score = fit, 0.0
    while full.exceeds_noise and len(full.effects) < most:
        trials = [trial for trial in forward(task, full, candidates).trials if len(trial.fit.effects) <= most]
        best = next((trial for trial in rank(trials) if trial.fit.cost < full.cost), None)
        if best is None:
            break
        full, score = best.fit, best.score
    while len(full.effects) > len(fit.effects) + 1:  # of one alone the ordinary selection decides
        task.progress(f"asking which of {' and '.join(full.names)} are needed")
        added = [effect for effect in full.effects if effect.name not in fit.names]
        without = [refit(task, full, tuple(e for e in full.effects if e is not effect)) for effect in added]
        needs = [
            (compare(task, less, full, (effect.name,), score), less)
            for effect, less in zip(added, without, strict=True)
            if less is not None
        ]
        weak = [(need, less) for need, less in needs if need.reason]
        if not weak and len(needs) == len(added):
            together = compare(task, fit, full, tuple(effect.name for effect in added), score)
            return None if together.reason else Step(together, (together,))
        if not weak:
            return None
        _, full = min(weak, key=lambda pair: pair[0].gain / pair[0].critical_gain)
    return None
