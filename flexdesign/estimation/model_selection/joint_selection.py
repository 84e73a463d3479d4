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
from flexdesign.estimation.model_selection.model_comparison import Step, Trial, compare, rank
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
        needs = [need for effect in added if (need := _need(task, full, effect, score)) is not None]
        weak = [need for need in needs if need.reason]
        if not weak and len(needs) == len(added):
            together = compare(task, fit, full, tuple(effect.name for effect in added), score)
            return None if together.reason else Step(together, (together,))
        if not weak:
            return None
        weakest = min(weak, key=lambda need: need.gain / need.critical_gain)
        less = refit(task, full, tuple(effect for effect in full.effects if effect.name not in weakest.names))
        if less is None:
            return None
        full = less
    return None


def _need(task: EstimationTask, fit: FittedModel, effect: Candidate, score: float) -> Trial | None:
    """Return the trial of an effect of a fit given its others; None where these cannot be simulated without it."""
    without = refit(task, fit, tuple(other for other in fit.effects if other is not effect))
    return None if without is None else compare(task, without, fit, (effect.name,), score)
