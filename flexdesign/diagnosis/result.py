"""What a diagnosis says: the verdict and everything behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, cast

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Parameter
from flexdesign.diagnosis.comparison import Comparison, RunComparison, join_halves, where
from flexdesign.dynamics.axis.axis_run import measured_stroke
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.model_comparison import Step
from flexdesign.estimation.model_selection.sparse_residual_model import SparseModel
from flexdesign.measurements.noise_level import LineNoise, NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run

Which = Literal["calibrated", "found"]


@dataclass(frozen=True)
class ErrorStep:
    """One step of the error ladder: a label, and the rms error on the validation runs [response]."""

    label: str
    error: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelResiduals:
    """A model compared with the runs: what a diagnosis, an addition and a confrontation have in common.

    Parameters
    ----------
    axis
        The axis that was looked at.
    before, model
        The stage model as it was, and with what was found.
    runs, responses
        The runs with their roles, as the axis sees them; and the frequency responses.
    noise, lines
        The noise floor of the runs, and the noise of each frequency response by its name.
    residuals_by_run
        The residual of each run by name, what its start explains taken out: ``calibrated`` without further effects, and
        ``found`` [response].
    error_ladder, noise_floor
        Errors on the runs that judge, from the model as designed to this one; and the rms noise of these [response].
    """

    axis: str
    before: StageModel
    model: StageModel
    runs: tuple[Run, ...]
    noise: NoiseFloor
    residuals_by_run: Mapping[str, Mapping[str, object]] = field(repr=False)
    responses: tuple[FrequencyResponse, ...] = ()
    lines: Mapping[str, LineNoise] = field(default_factory=dict)
    error_ladder: tuple[ErrorStep, ...] = ()
    noise_floor: float = 0.0


def compare_model(found: ModelResiduals, which: Which) -> Comparison:
    """Compare the runs with one of the two models, as `diagnosis.comparison` does for a model as it is."""
    left = cast("Mapping[str, Array]", found.residuals_by_run[which])
    model = found.before if which == "calibrated" else found.model
    responses = join_halves(found.responses, left, found.lines) if found.responses else ()
    if not found.runs:
        return Comparison(model, found.axis, (), found.noise, (), (), 0.0, responses)
    runs = compared_runs(found, which)
    residuals, predicted = ({run.name: getattr(run, of) for run in runs} for of in ("residual", "predicted"))
    return Comparison(
        model=model,
        axis=found.axis,
        runs=runs,
        noise=found.noise,
        where=where(residuals, found.runs, predicted, found.noise),
        observed=tuple(found.runs),
        seconds=0.0,
        responses=responses,
    )


def compared_runs(found: ModelResiduals, which: Which) -> tuple[RunComparison, ...]:
    """Return measurement and prediction of each run by one model, see `compare_model`."""
    if not found.runs:
        return ()
    left = cast("Mapping[str, Array]", found.residuals_by_run[which])
    stroke = measured_stroke(found.runs, found.axis)
    return tuple(
        RunComparison(
            name=run.name,
            role=run.role,
            time=run.time,
            command=run.command(),
            measured=np.where(np.isfinite(left[run.name]), run.measured(), np.nan),
            predicted=_without_gaps(run.measured() - left[run.name]),
            noise_floor=found.noise.rms[run.name],
            stroke=stroke,
            remarks=tuple(run.remarks),
        )
        for run in found.runs
    )


def _without_gaps(values: Array) -> Array:
    """Return values with straight lines over their gaps: position and velocity are needed there, too."""
    there = np.isfinite(values)
    places = np.arange(len(values), dtype=float)
    return np.asarray(np.interp(places, places[there], values[there]))


Verdict = Literal["nothing-missing", "effects-found", "unknown"]


@dataclass(frozen=True)
class Value:
    """A fitted number with its 95 % interval, SI.

    Parameters
    ----------
    parameter
        What it is, and its unit.
    value, interval
        The number and the interval.
    """

    parameter: Parameter
    value: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class IdentifiedEffect:
    """An effect that the measurements call for.

    Parameters
    ----------
    name
        Of the effect.
    values
        Its numbers; of one that differs from run to run the mean over the fitted runs.
    share
        Of what was unexplained (in squares, above the noise) on the validation runs: how much it explains.
    by_run
        Its strength in each run, where it differs from run to run; empty where one number does for all.
    """

    name: str
    values: tuple[Value, ...]
    share: float
    by_run: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class CandidateRecord:
    """A candidate that was fitted.

    Parameters
    ----------
    names
        The effect, or a pair of them.
    present
        The effects that were in the model then.
    error
        Root mean square error on the validation runs [response].
    share
        Of what was unexplained on the validation runs before (in squares, above the noise): how much it explains.
    evidence
        Fall of the cost, whitened, in multiples of what chance gives.
    outcome
        ``"added"``, or why it was not.
    """

    names: tuple[str, ...]
    present: tuple[str, ...]
    error: float
    share: float
    evidence: float
    outcome: str


@dataclass(frozen=True, eq=False)
class SelectionHistory:
    """The course of a selection, from the design to the last effect.

    Parameters
    ----------
    nominal, calibration
        The design, with initial conditions fitted; and with its own numbers fitted.
    fits
        The fit after each step that added effects.
    steps
        What was tried at each step, the last one without success.
    undetermined
        The model's own numbers that these runs cannot show: they keep their design values.
    is_refused
        Whether calibration made the validation runs worse, so that the design values were kept.
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
        """Return the fits from the calibrated one to the one whose effects are named."""
        place = next(i for i, fit in enumerate(self.levels) if {*named.names} <= {*fit.names})
        return (*self.levels[:place], named)

    def with_final(self, fit: FittedModel) -> SelectionHistory:
        """Return the course with another last fit of the same effects."""
        return replace(self, fits=(*self.fits[:-1], fit))


@dataclass(frozen=True, eq=False)
class Diagnosis(ModelResiduals):
    """What the measurements say about a stage model.

    Parameters
    ----------
    verdict
        Whether something is missing, and whether it is known.
    effects
        What was named, in the order in which it was added; empty unless effects were found.
    confusable
        Groups of effects that these runs do not distinguish; one of each is among `effects`.
    possible_effects
        Effects that were added and are possible, but not certain enough to be named, each with the share that it
        explains of the mean square which calibration leaves unexplained.
    candidates
        Everything that was fitted.
    calibration
        The model's own numbers after the fit.
    conflicts
        Numbers that had to move by more than three standard deviations of the prior, in words.
    validation_error
        Rms residual of the validation runs [response].
    sparse_model
        What smooth functions would explain of the rest.
    remainder
        What stays above the noise, in words; empty if nothing does.
    confidence
        What weakens the verdict, in words; empty if nothing does.
    evaluations, seconds
        How many predictions were made, and how long it took.
    remainder_rms
        Rms residual above the noise of the runs that judge; zero if the model is adequate [response].
    stroke, tolerance
        Largest peak-to-peak reading of a run, and what matters [response].
    undetermined
        The model's own numbers that these runs cannot show: they keep their design values.
    refusal
        Why the possible effects are not named, in words.
    """

    verdict: Verdict
    effects: tuple[IdentifiedEffect, ...]
    confusable: tuple[tuple[str, ...], ...]
    possible_effects: Mapping[str, float]
    candidates: tuple[CandidateRecord, ...]
    calibration: tuple[Value, ...]
    conflicts: tuple[str, ...]
    validation_error: float
    sparse_model: SparseModel
    remainder: str
    confidence: str
    evaluations: int = 0
    seconds: float = 0.0
    remainder_rms: float = 0.0
    stroke: float = 0.0
    tolerance: float = 0.0
    undetermined: tuple[str, ...] = ()
    refusal: str = ""
