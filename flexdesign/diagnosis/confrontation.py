"""A model and runs, kept in memory: effects are added and removed, parameters are set by hand.

The recordings are prepared and the model is calibrated once. A further effect then costs its own fit alone, by the same
steps as in a diagnosis; fits are cached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from threading import RLock
from typing import TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController, threadpool_limits

from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Parameter
from flexdesign.core.parallel_map import ParallelMap
from flexdesign.diagnosis import procedure, verdict
from flexdesign.diagnosis.comparison import Comparison, RunComparison
from flexdesign.diagnosis.effect_selection import candidates, estimation_setup
from flexdesign.diagnosis.effect_selection.estimation_setup import evaluate_design
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare
from flexdesign.diagnosis.result import ErrorStep, ModelResiduals, Value, compare_model, compared_runs
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.criterion import significant_deviation
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, evaluate_fit, predict_tests
from flexdesign.estimation.model_selection.forward_selection import Entry, finish, fit_candidate, fit_roughly, screen
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.measurements.recordings import FrequencyResponse, Run


@dataclass(frozen=True)
class AdjustableParameter:
    """A parameter of a model that may be set by hand.

    Parameters
    ----------
    parameter
        The parameter.
    value
        Its present value, SI.
    low, high
        The ends of its range, SI.
    """

    parameter: Parameter
    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Confronted(ModelResiduals):
    """A model with some effects, compared with the runs.

    Parameters
    ----------
    effects
        Names of the effects that were added.
    settings
        The fitted parameters, which may be set by hand.
    reason
        Why the effect that was added last is not needed; empty if it is, or if the fit is rough.
    is_rough
        Whether the effect that was added last is fitted roughly only.
    """

    effects: tuple[str, ...]
    settings: tuple[AdjustableParameter, ...]
    reason: str
    is_rough: bool = False

    @property
    def ratio(self) -> float:
        """The error over the noise floor."""
        return self.error / self.noise_floor

    @cached_property
    def compared_runs(self) -> tuple[RunComparison, ...]:
        """Measurement and prediction of each run."""
        return compared_runs(self, "found")

    @cached_property
    def comparison(self) -> Comparison:
        """The comparison of the model with the runs, with the location of its error."""
        return compare_model(self, "found")


Progress = Callable[[str], None]
Of = TypeVar("Of")
Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class _CachedFit:
    """A fit, its error, why its last effect is not needed, and whether it is fitted roughly only."""

    fit: FittedModel
    reason: str = ""
    is_rough: bool = False

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """The parameters that belong to no run, with their 95 % intervals, at the values that are shown."""
        return tuple(verdict.values_of(self.fit, is_fitted=False).values())


class Confrontation:
    """A stage model and recordings, ready for effects to be added and taken out.

    Parameters
    ----------
    model
        The stage model; its uncertainties say how far its numbers may move.
    recorded
        Runs and frequency responses; where nobody chose roles, they are split.
    axis
        Which one; may be left out where model and runs leave no choice.
    more
        Paths of effects in addition to those of the catalogue.
    noise
        Standard deviation of the noise of runs, where it is stated [response]; by default it is estimated.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If the axis is ambiguous, a run does not suit it, no run may be fitted, or the model cannot be simulated.
    """

    def __init__(
        self,
        model: StageModel,
        recorded: Sequence[Run | FrequencyResponse],
        *,
        axis: str | None = None,
        more: Sequence[str] = (),
        noise: float | None = None,
        progress: Progress = lambda _: None,
    ) -> None:
        self.model, self._more, self._progress = model, list(more), progress
        self._turn = RLock()  # one fit at a time
        progress("reading the noise")
        data = prepare(model, recorded, axis, None, noise)
        pool = ParallelMap(ThreadPoolExecutor(2, "confrontation"), 2)

        def each(function: Callable[[Of], Made], items: Iterable[Of]) -> list[Made]:
            def one(item: Of) -> Made:
                self._say("")  # what progress raises ends the work before the next simulation
                return function(item)

            return pool(one, items)

        with threadpool_limits(1):
            self.data: DiagnosisData = procedure.choose_interpolation(model, data, each, self._say)
            self._dynamics, self._case = estimation_setup.case_of(model, self.data, each, self._say)
            self._say("predicting with the model as it is")
            nominal = evaluate_design(replace(self._case, prior_bound=estimation_setup.PRIOR_BOUND), self._dynamics)
        self._nominal = predict_tests(self._case, nominal)
        self._kept: dict[tuple[str, ...], _CachedFit] = {}
        self._screened: dict[tuple[tuple[str, ...], str], tuple[float, list[Entry]]] = {}
        self._libraries = ThreadpoolController()  # to find them again takes as long as to simulate

    @cached_property
    def _calibrated_task(self) -> procedure.CalibratedTask:
        """The calibrated task; calibration runs at the first use."""
        begun = procedure.calibrate_task(self.data, self._case, self._dynamics)
        self._nominal = predict_tests(begun.task, begun.nominal)
        self._kept[()] = _CachedFit(predict_tests(begun.task, begun.calibrated))
        return begun

    @property
    def task(self) -> EstimationTask:
        """What is fitted, and to what."""
        return self._calibrated_task.task

    def _say(self, text: str) -> None:
        self._progress(text)

    @cached_property
    def catalogue(self) -> tuple[Candidate, ...]:
        """The effects that the axis does not have."""
        return candidates.catalogue(self.data, self._dynamics, self._calibrated_task.calibrated, more=self._more)

    def designed(self) -> Confronted:
        """Return the model as designed; only the initial conditions of the runs are fitted."""
        return self._confronted((), _CachedFit(self._nominal), is_designed=True)

    def with_effects(
        self, names: Sequence[str] = (), progress: Progress = lambda _: None, *, roughly: bool = False
    ) -> Confronted:
        """Return the calibrated model with some effects, in the order in which they are added.

        Parameters
        ----------
        names
            Of the effects; without any, the model is recalibrated alone.
        progress
            Receives the progress as text, an empty one as it continues; what it raises ends the fit.
        roughly
            Whether a rough fit of the last effect will do, if there is none to the end.

        Raises
        ------
        InputError
            If an effect is unknown, is in the model already or cannot be simulated.
        """
        chosen = tuple(names)
        with self._turn, self._libraries.limit(limits=1):
            self._progress = progress
            assert self._calibrated_task  # calibrates when it is first asked
            for count in range(1, len(chosen) + 1):
                kept, rough_will_do = self._kept.get(chosen[:count]), roughly and count == len(chosen)
                if kept is None or (kept.is_rough and not rough_will_do):
                    self._kept[chosen[:count]] = self._fit_last_effect(chosen[:count], rough_will_do)
            return self._confronted(chosen, self._kept[chosen])

    def offered(self, names: Sequence[str] = ()) -> tuple[str, ...]:
        """Return the names of the effects that may be added in addition to some others."""
        with self._turn:
            return tuple(c.name for c in self.catalogue if c.name not in names and c.after in ("", *names))

    def evidence(self, names: Sequence[str] = (), progress: Progress = lambda _: None) -> dict[str, float]:
        """Return what the residual of a model with some effects says for each further one, most first.

        That is the share of the unexplained chi^2 of the fitted runs that it removes, 0 to 1; zero where no more than
        chance is promised. All are fitted roughly.
        """
        chosen = tuple(names)
        with self._turn, self._libraries.limit(limits=1):
            self._progress = progress
            self.with_effects(chosen, progress)
            fit = self._kept[chosen].fit
            entries = self._screening(chosen)[1] if fit.exceeds_noise else []
            singles = {entry.start.names[0]: entry.solution.cost for entry in entries if len(entry.start.names) == 1}
        samples = fit.solution.problem.dataset.samples
        unexplained = max(fit.cost - samples, 1e-300)
        found = {
            name: float(np.clip((fit.cost - singles.get(name, fit.cost)) / unexplained, 0.0, 1.0))
            for name in self.offered(chosen)
        }
        return dict(sorted(found.items(), key=lambda pair: -pair[1]))

    def _screening(self, others: tuple[str, ...], name: str = "") -> tuple[float, list[Entry]]:
        """Return the critical value of scores, and the fits of an effect in addition to others; by default of all.

        Rough fits come before quick ones. Those of all effects serve for each of them.
        """
        for key in ((others, ""), (others, name)):
            if key in self._screened:
                return self._screened[key]
        expansion_points = () if others else self._calibrated_task.expansion_points
        fit = self._kept[others].fit
        tried = [candidate for candidate in self.catalogue if name in ("", candidate.name)]
        score, quick = screen(self.task, fit, tried, expansion_points)
        rough = fit_roughly(self.task, fit, quick)
        fitted = {entry.start.names for entry in rough}
        self._screened[key] = score, [*rough, *(entry for entry in quick if entry.start.names not in fitted)]
        return self._screened[key]

    def _fit_last_effect(self, chosen: tuple[str, ...], roughly: bool) -> _CachedFit:
        """Fit the last of some effects in addition to the others, roughly or to the end."""
        *others, name = chosen
        candidate = self._candidate(name, others)
        fit = self._kept[tuple(others)].fit
        score, entries = self._screening(tuple(others), name)
        for entry in (entry for entry in entries if entry.start.names == (name,)):
            if roughly and (rough := evaluate_fit(self.task, entry.solution, entry.start.effects)):
                return _CachedFit(predict_tests(self.task, rough), is_rough=True)
            if trial := finish(self.task, fit, entry, score):
                return _CachedFit(predict_tests(self.task, trial.fit), trial.reason)
        # It promises nothing; its value then says how large it may be at most.
        made = predict_tests(self.task, fit_candidate(self.task, fit, candidate, roughly=roughly))
        return _CachedFit(made, "" if roughly else "no more than chance gives", roughly)

    def _candidate(self, name: str, others: Sequence[str]) -> Candidate:
        found = next((each for each in self.catalogue if each.name == name), None)
        if name in others or found is None:
            remedy = "is in the model already, or these recordings cannot show it; choose one of the list"
            raise InputError("command line", "effect", name, remedy)
        return found

    def simulate(self, names: Sequence[str], values: Mapping[str, float]) -> Confronted:
        """Return a model with effects that was fitted, some numbers set by hand (SI); nothing is fitted anew.

        Raises
        ------
        InputError
            If a number is unknown, or the model grows without bound at these values.
        """
        chosen = tuple(names)
        if chosen not in self._kept:
            self.with_effects(chosen)
        kept = self._kept[chosen]
        known = [parameter.name for parameter in kept.fit.solution.problem.where.parameters if not parameter.run]
        for name, value in values.items():
            if name not in known:
                raise InputError("command line", name, value, f"is no number of this model{suggest(name, known)}")
        # Coarse steps serve: what is shown is seen, not fitted.
        model = self.task.coarse(kept.fit.model.replace(dict(values)))
        pairs = [(d, r) for d in (self.task.identify, self.task.validate, self.task.test) if d for r in d.records]
        with self._turn, self._libraries.limit(limits=1):
            self._progress = lambda _: None
            found = self.task.each(lambda pair: pair[0].remainder(pair[1], model.predict(pair[1].observation)), pairs)
        if not all(np.isfinite(rest[record.present]).all() for rest, (_, record) in zip(found, pairs, strict=True)):
            raise InputError("model", f"axis.{self.data.name}", None, "grows without bound at these values; go back")
        residuals = {record.observation.name: rest for rest, (_, record) in zip(found, pairs, strict=True)}
        fit = replace(kept.fit, model=model, residuals_by_run=residuals)
        return self._confronted(chosen, _CachedFit(fit, kept.reason), by_hand=values)

    def values(self, names: Sequence[str] = ()) -> tuple[Value, ...]:
        """Return the numbers of a model that was fitted, its own first, with their 95 % intervals."""
        with self._turn, self._libraries.limit(limits=1):
            self.with_effects(names)  # the intervals are those of a fit to its end
            return self._kept[tuple(names)].values

    def _confronted(
        self,
        chosen: tuple[str, ...],
        kept: _CachedFit,
        is_designed: bool = False,
        by_hand: Mapping[str, float] | None = None,
    ) -> Confronted:
        fit, data = kept.fit, self.data
        added = [] if is_designed else [self._kept[chosen[:count]].fit for count in range(len(chosen) + 1)]
        steps = verdict.error_steps(data, [self._nominal, *added])
        if by_hand is not None:
            steps = (*steps, ErrorStep("set by hand", data.test_error(fit)))
        return Confronted(
            effects=chosen,
            error_ladder=steps,
            noise_floor=data.noise_rms,
            settings=_adjustable(fit, by_hand or {}),
            reason=kept.reason,
            before=self.model,
            model=verdict.model_of(self.model, data, fit, {}),
            axis=data.name,
            runs=data.runs,
            responses=data.responses,
            noise=data.noise,
            lines=data.lines,
            residuals_by_run={"found": fit.residuals_by_run},
            is_rough=kept.is_rough,
        )


def _adjustable(fit: FittedModel, by_hand: Mapping[str, float]) -> tuple[AdjustableParameter, ...]:
    """Return the parameters of a fit that belong to no run; those in `by_hand` have these values, SI.

    One with a prior may be set within a deviation from it that chance explains, another from a half to twice its value.
    """
    where, x = fit.solution.problem.where, fit.solution.x
    values, known, adjustable = where.values(x), where.known, []
    for parameter in where.parameters:
        if parameter.run:
            continue
        fitted = values[parameter.name]
        half = 0.5 * abs(fitted) or 1.0
        low, high = fitted - half, fitted + 2 * half
        if parameter.name in known and parameter.scale == "linear":
            middle, sigma = known[parameter.name]
            far = significant_deviation() * sigma
            low, high = min(fitted, middle - far), max(fitted, middle + far)
        if parameter.null is not None and math.isfinite(parameter.null):
            low, high = min(low, parameter.null), max(high, parameter.null)
        low, high = max(low, parameter.plausible[0]), min(high, parameter.plausible[1])
        present = by_hand.get(parameter.name, fitted)
        adjustable.append(AdjustableParameter(parameter, present, min(low, fitted), max(high, fitted)))
    return tuple(adjustable)
