"""Selection of effects: stepwise regression with backward elimination, and what the runs do not determine of them.

Steps forward are those of `forward_selection`. Miller, Subset Selection in Regression, 2002, describes the methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from flexdesign.core.model import parameter_of
from flexdesign.estimation.criterion import LEVEL, SHARE, critical_value, is_worse
from flexdesign.estimation.least_squares.residual_function import null_of
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    fit_in_place,
    fit_model,
    refit,
    with_effects,
)
from flexdesign.estimation.model_selection.forward_selection import forward
from flexdesign.estimation.model_selection.model_comparison import (
    Step,
    Trial,
    compare,
    is_indistinguishable,
    rank,
)
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.uncertainty.identifiability import intervals


@dataclass(frozen=True, eq=False)
class SelectionHistory:
    """The course of a selection, from the design to the last effect.

    Parameters
    ----------
    nominal, calibration
        The fit of the initial conditions alone, with the design values; and the fit after calibration.
    fits
        The fit after each step that added effects.
    steps
        The steps with their trials; the last step added nothing.
    undetermined
        Parameters that the runs do not determine: they keep their design values, defaults or fitted values.
    is_refused
        Whether calibration increased the validation error, so that the design values were kept.
    """

    nominal: FittedModel
    calibration: FittedModel
    fits: tuple[FittedModel, ...]
    steps: tuple[Step, ...]
    undetermined: tuple[str, ...] = ()
    is_refused: bool = False

    @property
    def levels(self) -> tuple[FittedModel, ...]:
        """The fits from the calibrated model on, each with further effects."""
        return (self.calibration, *self.fits)

    @property
    def final(self) -> FittedModel:
        """The last fit."""
        return self.levels[-1]

    def levels_to(self, named: FittedModel) -> tuple[FittedModel, ...]:
        """Return the fits from the calibrated one to `named`, whose effects are named."""
        place = next(i for i, fit in enumerate(self.levels) if {*named.names} <= {*fit.names})
        return (*self.levels[:place], named)

    def refused_beyond(self, named: FittedModel) -> tuple[FittedModel, ...]:
        """Return the fits with further effects than `named` that explain a share with evidence but are not named."""
        trials = [trial for step in self.steps for trial in step.trials if {*named.names} < {*trial.fit.names}]
        return tuple(trial.fit for trial in trials if trial.gain >= trial.critical_gain and trial.share >= SHARE)


def backward(task: EstimationTask, fit: FittedModel, tested: Sequence[str]) -> FittedModel:
    """Return the fit without those of the effects `tested` that have lost their evidence given the others."""
    for effect in fit.effects:
        rest = tuple(other for other in fit.effects if other.name != effect.name)
        if effect.name not in tested or not rest:
            continue
        critical_gain = critical_value(float(chdtri(1, LEVEL)), len(effect.free)) * fit.discrepancy
        without = refit(task, fit, rest)
        if without is not None and without.cost - fit.cost < critical_gain:
            return backward(task, without, tested)
    return fit


def select(
    task: EstimationTask,
    fit: FittedModel,
    candidates: Sequence[Candidate],
    most: int,
    *,
    confirmed: tuple[Sequence[Step], Sequence[FittedModel]] = ((), ()),
    expansion_points: Sequence[FittedModel] = (),
    vary_step: Callable[[FittedModel, Step], Step] = lambda _, step: step,
    vary: Callable[[FittedModel], FittedModel] = lambda fit: fit,
    step_forward: Callable[[EstimationTask, FittedModel, Sequence[Candidate], Sequence[FittedModel]], Step] = forward,
) -> tuple[list[Step], list[FittedModel]]:
    """Return the steps of a selection, and the fits with the effects that stay, each with further ones.

    Parameters
    ----------
    task, fit
        The runs, and the fit from which the selection starts.
    candidates
        The catalogue.
    most
        Largest number of effects.
    confirmed
        Steps that were taken before, and the fits after them.
    expansion_points
        See `forward`; used at the first step.
    vary_step, vary
        Return a step from a fit, and a fit, with strengths that differ from run to run if the runs call for that.
        `vary` is called when nothing more can be added, because a missing effect may look like a different strength of
        a present effect in each run.
    step_forward
        Returns the next forward step.
    """
    steps, fits = list(confirmed[0]), list(confirmed[1])
    while True:
        fit, made = fits[-1] if fits else fit, None
        if len(fit.effects) < most:
            steps.append(vary_step(fit, step_forward(task, fit, candidates, () if fits else expansion_points)))
            made = _with_step(task, fit, steps[-1])
            if made is None:
                steps[-1] = replace(steps[-1], chosen=None)
        if made is None:
            made = vary(fit)
            if made is fit:
                break
        fits = _nested([*fits, made])
    return steps, fits


def _nested(fits: Sequence[FittedModel]) -> list[FittedModel]:
    """Return the fits whose effects are all in the last one; of fits with the same effects, only the last."""
    by_effects = {frozenset(fit.names): fit for fit in fits if {*fit.names} <= {*fits[-1].names}}
    return list(by_effects.values())


def _with_step(task: EstimationTask, fit: FittedModel, step: Step) -> FittedModel | None:
    """Return the fit after a step, without effects that are then superfluous; None if the step adds nothing."""
    if step.chosen is None:
        return None
    doubtful = fit.names if len(step.chosen.names) == 1 else step.chosen.fit.names
    made = backward(task, step.chosen.fit, doubtful)
    return None if {*made.names} == {*fit.names} else made  # the added effect itself was superfluous


# --- alternatives ---------------------------------------------------------------------------------------------------


def confusable(task: EstimationTask, fit: FittedModel, steps: Sequence[Step]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of confounded effects, the one in the model first.

    An effect that did as well at a step as the chosen one is fitted in its place, with all effects that were added
    later.
    """
    groups = list[tuple[str, ...]]()
    for step in steps:
        for name in step.chosen.names if step.chosen else ():
            if name not in fit.names or any(name == group[0] for group in groups):
                continue
            instead = [
                other.name
                for other, trial in _alternatives(step, name, fit)
                if (made := fit_in_place(task, fit, name, other, trial.fit.model)) and is_indistinguishable(fit, made)
            ]
            if instead:
                groups.append((name, *instead))
    return tuple(groups)


def _alternatives(step: Step, name: str, fit: FittedModel) -> list[tuple[Candidate, Trial]]:
    """Return the effects that did as well as one that a step added, and their trials."""
    partners = {*(step.chosen.names if step.chosen else ())} - {name}
    return [
        (effect, trial)
        for trial in step.alike
        for effect in trial.fit.effects
        if {*trial.names} == {*partners, effect.name} and effect.name not in fit.names
    ]


def restart_without(task: EstimationTask, fit: FittedModel, trials: Sequence[Trial]) -> FittedModel:
    """Return the fit restarted from the best of refused trials, without its effects, if all runs then fit better.

    A further effect may only have moved the other parameters out of a local minimum.
    """
    if not trials or trials[0].gain <= trials[0].critical_gain:
        return fit
    task.progress("fitting from other values")
    restarted = refit(task, trials[0].fit, fit.effects)
    if restarted is None or restarted.validation_chi2 > fit.validation_chi2:
        return fit
    return restarted if fit.cost - restarted.cost > trials[0].critical_gain else fit


def add_together(task: EstimationTask, fit: FittedModel, candidates: Sequence[Candidate], most: int) -> Step | None:
    """Return a step that adds several effects, each with evidence given the others; None where there is none.

    If several effects are missing, the residual of a model with one of them is so large and so correlated that the fall
    of chi^2 may be chance. Effects are therefore added one after the other without the check of evidence. Those without
    evidence given the others are then dropped one by one (Miller 2002, section 3.3).
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


# --- what the runs do not determine ----------------------------------------------------------------------------------


def hold_undetermined(task: EstimationTask, fit: FittedModel) -> tuple[FittedModel, tuple[str, ...]]:
    """Return the fit with undetermined parameters of its effects held, and their names; the same fit without any."""
    catalogue = {p.name: p.start for p in with_effects(task.bare(fit.model), fit.effects).parameters()}
    defaults = {
        name: float(catalogue[name] or 0.0)
        for effect in fit.effects
        for name in effect.free
        if name != effect.strength and catalogue.get(name) is not None and _is_open(fit, name, catalogue[name] or 0.0)
    }
    if not defaults:
        return fit, ()
    effects = tuple(replace(e, free=tuple(n for n in e.free if n not in defaults)) for e in fit.effects)
    refitted = fit_model(task, fit.model.replace(defaults), effects)
    # A default that contradicts the fitted runs is not held.
    if refitted is None or refitted.cost - fit.cost > -2.0 * math.log(LEVEL) * fit.discrepancy:
        return fit, ()
    scored = task.scored or task.validate.names
    if scored and is_worse(refitted.rms(scored, task.scales), fit.rms(scored, task.scales)):
        # The defaults predict the validation runs worse: the fitted values are held.
        refitted = fit_model(task, fit.model, effects) or refitted
    return refitted, tuple(defaults)


def _is_open(fit: FittedModel, name: str, default: float) -> bool:
    """Tell whether the interval of a parameter includes a default of zero, or most of the plausible range."""
    where = fit.solution.problem.where
    j = where.names.index(name)
    if fit.is_undetermined(j):
        return True
    is_linear = where.parameters[j].scale == "linear"
    return default == 0 and is_linear and abs(float(fit.solution.x[j])) < fit.half_width(j)


def drop_undetermined(task: EstimationTask, fit: FittedModel) -> FittedModel:
    """Return the fit without effects whose strength has an interval that includes the null, or none.

    Effects are added by the covariance, which may mislead. These intervals are those of the report.
    """
    for effect in reversed(fit.effects):
        if not _excludes_null(fit, effect.strength):
            without = refit(task, fit, tuple(other for other in fit.effects if other is not effect))
            return fit if without is None else drop_undetermined(task, without)
    return fit


def _excludes_null(fit: FittedModel, name: str) -> bool:
    """Tell whether the interval of a strength excludes its null, and the end of the plausible range next to the null.

    If the residual is noise, the mean of a strength that differs from run to run may be anything. If it exceeds the
    noise, the mean must exclude the null, too: the strength of an approximation also differs from run to run.
    """
    if fit.deviations(name) and not fit.exceeds_noise:
        return True
    if fit.deviations(name):
        mean, half_width = fit.mean_over_runs(name)
        interval: tuple[float, float] | None = (mean - half_width, mean + half_width)
    else:
        interval = intervals(fit.solution, [name])[0].interval
    if interval is None:
        return False
    parameter, (low, high) = parameter_of(fit.model, name), interval
    null = float(np.clip(null_of(parameter), *parameter.plausible))
    return not (low <= null <= high or any(math.isclose(null, end, rel_tol=1e-6) for end in (low, high)))
