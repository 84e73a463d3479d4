"""Effects that the runs do not distinguish: alternatives to what was added, fitted in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexdesign.estimation.criterion import cannot_tell_apart
from flexdesign.estimation.least_squares.levenberg_marquardt import ROUGH
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model, with_other_effects
from flexdesign.estimation.model_selection.model_comparison import (
    Step,
    Trial,
    bic_lead,
    is_indistinguishable,
)
from flexdesign.estimation.model_selection.restarts import escape
from flexdesign.estimation.model_selection.score_test import Candidate

#: Largest number of effects in a group of confounded effects.
LARGEST_GROUP = 3


def confusable(task: EstimationTask, fit: FittedModel, steps: Sequence[Step]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of confounded effects, the one in the model first.

    Effects that did as well when one was added are fitted in its place with all that were added later. So are those
    that it is known to be taken for, if they explained as much but for `SHARE`: of approximations, a fit may be in a
    local minimum, which is left first.
    """
    groups = list[tuple[str, ...]]()
    for step in steps:
        for name in step.chosen.names if step.chosen else ():
            if name not in fit.names or any(name == group[0] for group in groups):
                continue
            instead = [
                other.name
                for other, trial in _alternatives(step, step.rivals, name, fit)
                if _does_as_well(task, fit, name, other, trial)
            ]
            if instead:
                groups.append((name, *instead[: LARGEST_GROUP - 1]))
    return tuple(groups)


def replace_effects(task: EstimationTask, fit: FittedModel, steps: Sequence[Step]) -> tuple[list[Step], FittedModel]:
    """Return the steps and the fit with alternatives in the place of effects (sequential replacement: Miller 2002).

    What was added first may have imitated two effects at once. Each alternative that was accepted at its step is fitted
    roughly in its place with all that were added later, and the best of them to the end; BIC must prefer it by more
    than what decides nothing.
    """
    steps = list(steps)
    for k, step in enumerate(steps):
        for name in step.chosen.names if step.chosen else ():
            if name not in fit.names:
                continue
            accepted = [trial for trial in step.trials if not trial.reason]
            roughly = [
                (found, trial)
                for other, trial in _alternatives(step, accepted, name, fit)
                if (found := _in_place(task, fit, name, other, trial, roughly=True)) is not None
            ]
            if not roughly:
                continue
            rough, chosen = max(roughly, key=lambda pair: bic_lead(pair[0], fit))
            best = fit_model(task, task.fine(rough.model), rough.effects, old=rough.solution.columns())
            if best is not None and not cannot_tell_apart(bic_lead(best, fit), fit.discrepancy):
                fit, steps[k] = best, replace(step, chosen=chosen)
    return steps, fit


def _alternatives(step: Step, trials: Sequence[Trial], name: str, fit: FittedModel) -> list[tuple[Candidate, Trial]]:
    """Return the effects that trials of a step have in the place of one that it added, and the trial of each."""
    partners = {*(step.chosen.names if step.chosen else ())} - {name}
    return [
        (effect, trial)
        for trial in trials
        for effect in trial.fit.effects
        if {*trial.names} == {*partners, effect.name} and effect.name not in fit.names
    ]


def _in_place(
    task: EstimationTask, fit: FittedModel, name: str, other: Candidate, trial: Trial, *, roughly: bool = False
) -> FittedModel | None:
    """Return the fit with another effect in the place of one, from the values that it had in a trial."""
    effects = tuple(other if effect.name == name else effect for effect in fit.effects)
    task.progress(f"fitting with {other.name} in the place of {name}")
    model = with_other_effects(task, fit, effects, trial.fit.model)
    return fit_model(task, task.coarse(model), effects, effort=ROUGH) if roughly else fit_model(task, model, effects)


def _does_as_well(task: EstimationTask, fit: FittedModel, name: str, other: Candidate, trial: Trial) -> bool:
    """Tell whether an effect in the place of another explains as much."""
    made = _in_place(task, fit, name, other, trial)
    if made is not None and fit.exceeds_noise and not is_indistinguishable(fit, made):
        made = escape(task, made)
    return made is not None and is_indistinguishable(fit, made)
