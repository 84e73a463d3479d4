"""Selections that begin with another effect: two lags may stand in for a delay, and no addition ever shows that.

Forward selection adds the best effect beside those that it has. Where several are missing at once the first choice may
only imitate what two others would be together, and the fit is then caught beside it. Where more than noise is left, the
selection is made again from each effect that was accepted at its first step; the best one counts (a beam search).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexdesign.evidence.case import Case
from flexdesign.evidence.model_comparison import Step, Trial, is_alike
from flexdesign.evidence.screening import Candidate
from flexdesign.evidence.selection import backward, forward, leaves_more_than_noise
from flexdesign.evidence.stand import Stand, fitted
from flexdesign.model import Model

#: A selection and the fits after each of its steps.
Path = tuple[list[Step], list[Stand]]


def begun_otherwise(case: Case, path: Path, base: Model, candidates: Sequence[Candidate], most: int) -> Path:
    """Return the best of the selections that begin with another accepted effect; a given one if it is the best.

    Parameters
    ----------
    case, candidates
        What is diagnosed, and all effects that may be added.
    path
        A selection.
    base
        The model without effects.
    most
        Largest number of effects.
    """
    steps, stands = path
    if not stands:
        return path
    for trial in steps[0].trials:
        chosen = steps[0].chosen
        if not leaves_more_than_noise(path[1][-1]):
            break
        if trial.reason or len(trial.names) > 1 or chosen is None or trial.names == chosen.names:
            continue
        tried = _greedy(case, trial, steps[0], base, candidates, most)
        if tried[1][-1].total < path[1][-1].total:
            path = tried
    return path


def _greedy(case: Case, trial: Trial, first: Step, base: Model, candidates: Sequence[Candidate], most: int) -> Path:
    """Return the selection that begins with a trial of the first step."""
    stand = fitted(case, case.fine(trial.stand.model), trial.stand.effects, {}, old=trial.stand.solution.columns())
    stand = stand or trial.stand
    chosen = replace(trial, stand=stand)
    alike = (t for t in first.trials if t.names != trial.names and not t.reason and is_alike(stand, t.stand))
    steps, stands = [replace(first, chosen=chosen, alike=tuple(alike))], [stand]
    while len(stand.effects) < most:
        steps.append(forward(case, stand, candidates))
        if (added := steps[-1].chosen) is None:
            break
        stand = backward(case, added.stand, base, candidates)
        if stand.names == stands[-1].names:  # what was added made itself superfluous
            break
        stands.append(stand)
    return steps, stands
