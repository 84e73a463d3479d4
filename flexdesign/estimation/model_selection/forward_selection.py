"""One forward step of the selection: the one or two effects to add that explain most.

There are many candidates, and fits are expensive. Candidates therefore compete in rounds (successive halving: Jamieson
and Talwalkar 2016). All with a sufficient score take steps with the known Jacobian; the best of them are fitted
roughly; the finalists are fitted to convergence and compared, see `flexdesign.estimation.criterion`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.core.errors import InputError
from flexdesign.core.model import parameter_of
from flexdesign.estimation.criterion import LARGE, LEVEL, SHARE, large_share
from flexdesign.estimation.least_squares.levenberg_marquardt import FULL, ROUGH, Solution
from flexdesign.estimation.model_selection.estimation_task import FINALISTS, EstimationTask, grid_initial_states
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    escape,
    fit_in_place,
    fit_model,
    solve_case,
)
from flexdesign.estimation.model_selection.model_comparison import Step, Trial, best_of, compare, rank
from flexdesign.estimation.model_selection.score_test import Candidate, Direction, Screening

#: Trials of one candidate from which fits start: the best alone may lead to a local minimum.
STARTS_PER_CANDIDATE = 2
#: Reduced chi^2 above which the Jacobian and the initial states of the present fit mislead.
GROSS_MISFIT = 30.0


@dataclass(frozen=True, eq=False)
class _Start:
    """Where a fit with further effects starts: at a fit without them, in the directions of one or two trials."""

    origin: FittedModel
    directions: tuple[Direction, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(direction.candidate.name for direction in self.directions)

    @property
    def predicted_reduction(self) -> float:
        """What the score of the best of them predicts."""
        return max(direction.predicted_reduction for direction in self.directions)

    @property
    def effects(self) -> tuple[Candidate, ...]:
        return (*self.origin.effects, *(direction.candidate for direction in self.directions))


@dataclass(frozen=True, eq=False)
class Entry:
    """A fit in a round of the competition."""

    start: _Start
    solution: Solution


def screen(
    task: EstimationTask,
    fit: FittedModel,
    candidates: Sequence[Candidate],
    expansion_points: Sequence[FittedModel] = (),
) -> tuple[float, list[Entry]]:
    """Return the critical value of the largest score, and quick fits of candidates with a sufficient score, best first.

    Parameters are those of `forward`.
    """
    left = [c for c in candidates if c.name not in fit.names and c.after in ("", *fit.names)]
    task.progress("screening the catalogue" if not fit.effects else f"screening with {', '.join(fit.names)}")
    score, starts = 0.0, list[_Start]()
    for origin in (fit, *expansion_points):
        screening = Screening(origin.solution, left, task.coarse)
        score = score or screening.critical_value(LEVEL)
        starts += _starts(origin, screening, max(score, SHARE * origin.excess) / LARGE)

    def quickly(start: _Start) -> Entry | None:
        task.progress(f"trying {' and '.join((*fit.names, *start.names))}")
        return _quick_fit(task, start)

    return score, _best_by_names(task.each(quickly, starts))


def fit_roughly(task: EstimationTask, fit: FittedModel, entries: Sequence[Entry]) -> list[Entry]:
    """Return rough fits of the best entries, from the initial states of the runs that fit best; best first.

    Entries are the best quick fits, and the best scores among the other single candidates, because a quick fit may go
    astray.
    """

    def roughly(entry: Entry) -> Entry | None:
        task.progress(f"fitting roughly with {' and '.join((*fit.names, *entry.start.names))}")
        solution = entry.solution
        model = solution.problem.at(solution.x)
        if fit.exceeds_noise:  # otherwise the runs begin where they do
            model = grid_initial_states(solution.problem.dataset, model, task.each)
        found = solve_case(task, model, entry.start.effects, old=solution.columns(), effort=ROUGH)
        return None if found is None else replace(entry, solution=found)

    best, rest = entries[: 2 * FINALISTS], entries[2 * FINALISTS :]
    others = [e for e in rest if e.start.origin is fit and len(e.start.names) == 1]
    others.sort(key=lambda e: -e.start.predicted_reduction)
    return _best_by_names(task.each(roughly, [*best, *others[:FINALISTS]]))


def forward(
    task: EstimationTask,
    fit: FittedModel,
    candidates: Sequence[Candidate],
    expansion_points: Sequence[FittedModel] = (),
) -> Step:
    """Return the forward step: its trials, and the best addition or none.

    Parameters
    ----------
    task, fit
        The runs, and the present fit.
    candidates
        The catalogue.
    expansion_points
        Further fits from which additions are tried, such as the design if calibration led astray.
    """
    score, entries = screen(task, fit, candidates, expansion_points)
    # With a residual, an effect is not named that takes less of what calibration left, and by itself no more than that
    # can be had from a small one.
    least = min(SHARE * max(task.calibrated_excess, fit.excess), fit.excess)
    singles, pairs = _compete(task, fit, entries, least / LARGE)
    trials = _trials(task, fit, singles, score)
    best = best_of(task, trials)
    if (fit if best is None else best.fit).exceeds_noise:
        # Fits in local minima would be refused, and call for effects that are not there.
        first = rank(trials)[:FINALISTS]
        trials = [_escape(task, fit, trial) if trial in first else trial for trial in trials]
        trials += _trials(task, fit, pairs, score)
        trials += _replaced(task, fit, best_of(task, trials), trials, score)
    return Step(best_of(task, trials), tuple(rank(trials)))


def _starts(origin: FittedModel, screening: Screening, enough: float) -> list[_Start]:
    """Return starting points: the best trials of each candidate, and pairs with a larger score than single ones."""
    best = screening.best()
    found = [
        _Start(origin, (each,))
        for directions in best
        for each in directions[:STARTS_PER_CANDIDATE]
        if each.predicted_reduction > enough
    ]
    most = best[0][0].predicted_reduction if best else 0.0
    pairs = [(a, b) for predicted_gain, a, b in screening.pairs(FINALISTS) if predicted_gain > most + enough]
    return found + [_Start(origin, pair) for pair in pairs]


def _compete(
    task: EstimationTask, fit: FittedModel, entries: Sequence[Entry], least: float
) -> tuple[list[Entry], list[Entry]]:
    """Return the fits that are to be fitted to convergence, with one further effect and with two.

    As rough fits they must lower chi^2 by more than `least`; a pair must explain much of what the best single effect
    leaves.
    """
    roughly = fit_roughly(task, fit, entries)
    candidates = [entry for entry in roughly if fit.cost - entry.solution.cost > least]
    singles = [entry for entry in candidates if len(entry.start.names) == 1]
    cost = singles[0].solution.cost if singles else fit.cost
    cost -= large_share() / LARGE * max(cost - fit.solution.problem.dataset.samples, 0.0)
    pairs = [entry for entry in candidates if len(entry.start.names) == 2 and entry.solution.cost < cost]
    return singles[:FINALISTS], pairs[:FINALISTS]


def _best_by_names(entries: Sequence[Entry | None]) -> list[Entry]:
    """Return the best entry of each candidate or pair, best first."""
    best: dict[tuple[str, ...], Entry] = {}
    for entry in sorted((entry for entry in entries if entry is not None), key=lambda entry: entry.solution.cost):
        best.setdefault(entry.start.names, entry)
    return list(best.values())


def _quick_fit(task: EstimationTask, start: _Start) -> Entry | None:
    """Return the quick fit: steps with the known Jacobian, coarsely simulated.

    A limit moves the prediction so far that the Jacobian without it misleads, as does one at a gross misfit: it is
    then computed at the start. At a gross misfit the initial states of runs mislead as well, and are held.
    """
    origin, model, values = start.origin, start.origin.model, dict[str, float]()
    old = dict(origin.solution.columns())
    ends = np.cumsum([record.rows for record in origin.solution.problem.dataset.records])[:-1]
    for direction in start.directions:
        model = direction.candidate.add(model)
        values |= direction.start
        strength = direction.candidate.strength
        if parameter_of(model, strength).scale == "linear" and not direction.candidate.has_own_trials:
            old[strength] = [-part for part in np.split(direction.move / direction.values[strength], ends)]
    bounds = {parameter.name: parameter.plausible for parameter in model.parameters()}
    begun = {name: float(np.clip(value, *bounds.get(name, (-math.inf, math.inf)))) for name, value in values.items()}
    is_gross = origin.scale > GROSS_MISFIT
    is_misleading = is_gross or any(direction.candidate.has_own_trials for direction in start.directions)
    model, effort = task.coarse(model.replace(begun)), replace(ROUGH, jacobians=0, holds_initial_states=is_gross)
    found = solve_case(task, model, start.effects, old=None if is_misleading else old, effort=effort)
    return None if found is None else Entry(start, found)


def _trials(task: EstimationTask, fit: FittedModel, entries: Sequence[Entry], score: float) -> list[Trial]:
    found = task.each(lambda entry: finish(task, fit, entry, score), entries)
    return [trial for trial in found if trial is not None]


def finish(task: EstimationTask, fit: FittedModel, entry: Entry, score: float) -> Trial | None:
    """Return the trial of a rough fit, fitted to convergence; None if it cannot be simulated.

    Initial states are those that fit best on the grid; `score` is the critical value that `screen` returns. The fit is
    repeated with more exact simulations if it halves the residual, for which the rough one chose their error.
    """
    task.progress(f"fitting with {' and '.join((*fit.names, *entry.start.names))}")
    solution = entry.solution
    scale = solution.cost / solution.problem.dataset.samples
    model = grid_initial_states(solution.problem.dataset, task.fine(solution.problem.at(solution.x), scale), task.each)
    made = fit_model(task, model, entry.start.effects, old=solution.columns())
    while made is not None and 4 * max(made.scale, 1.0) < scale:
        scale = made.scale
        made = fit_model(task, task.fine(made.model, scale), entry.start.effects, old=made.solution.columns())
    return None if made is None else compare(task, fit, made, entry.start.names, score)


def _replaced(
    task: EstimationTask, fit: FittedModel, best: Trial | None, trials: Sequence[Trial], score: float
) -> list[Trial]:
    """Return the best pair with other finalists in the place of one that explains alone, too (Miller 2002).

    Only few pairs are fitted. Where an effect hides another, the score of a pair does not show which of several similar
    effects, such as the bandwidths of a driver and a sensor, the hidden one has next to it.
    """
    singles = {trial.names[0]: trial for trial in trials if len(trial.names) == 1}
    if best is None or len(best.names) == 1:
        return []
    found = list[Trial]()
    for own, other in itertools.product(best.names, singles):
        if own not in singles or other in best.names:
            continue
        (candidate,) = (effect for effect in singles[other].fit.effects if effect.name == other)
        made = fit_in_place(task, best.fit, own, candidate, singles[other].fit.model)
        if made is not None:
            names = tuple(other if name == own else name for name in best.names)
            found.append(_escape(task, fit, compare(task, fit, made, names, score)))
    return found


def _escape(task: EstimationTask, fit: FittedModel, trial: Trial) -> Trial:
    """Return the trial with its fit restarted from other thresholds, if it has more evidence than chance gives."""
    better = escape(task, trial.fit, trial.names) if trial.gain > trial.critical_gain else trial.fit
    return trial if better is trial.fit else compare(task, fit, better, trial.names, trial.score)


def fit_candidate(
    task: EstimationTask, fit: FittedModel, candidate: Candidate, *, roughly: bool = False
) -> FittedModel:
    """Return the best fit with an effect without a score; its interval says how large the effect may be at most.

    A rough fit uses coarse simulations.

    Raises
    ------
    InputError
        If the effect cannot be simulated at any of its first values.
    """
    added, effects = candidate.add(fit.model), (*fit.effects, candidate)
    model, effort = (task.coarse(added), ROUGH) if roughly else (task.fine(added, fit.scale), FULL)
    starts = [model.replace(values) for values in candidate.trials[: 2 * FINALISTS]]
    made = [found for start in starts if (found := fit_model(task, start, effects, effort=effort))]
    if not made:
        raise InputError(
            "command line", "EFFECT", candidate.name, "cannot be simulated on this axis at any of its values"
        )
    return min(made, key=lambda found: found.cost)
