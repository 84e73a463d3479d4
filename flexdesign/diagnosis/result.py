"""The result of a diagnosis: the verdict, and the fits, residuals and trials that it rests on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Parameter
from flexdesign.diagnosis.comparison import Comparison, RunComparison, join_halves, where
from flexdesign.dynamics.axis.axis_run import measured_stroke
from flexdesign.dynamics.stage_model import StageModel
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
    """A model compared with the runs: the common part of a diagnosis, an added effect and a confrontation.

    Parameters
    ----------
    axis
        Name of the axis.
    before, model
        The stage model as it was, and the fitted one with the named effects.
    runs, responses
        The runs of the axis with their roles; and the frequency responses.
    noise, lines
        The noise floor of the runs, and the noise of each frequency response by its name.
    residuals_by_run
        The residual of each run by name, after its initial conditions are fitted: ``calibrated`` without effects that
        were added, and ``found`` with them [response].
    error_ladder, noise_floor
        Errors of the scored runs, from the model as designed to this one; and the rms noise of these runs [response].
    """

    axis: str
    before: StageModel
    model: StageModel
    runs: tuple[Run, ...]
    noise: NoiseFloor
    residuals_by_run: Mapping[str, Mapping[str, Array]] = field(repr=False)
    responses: tuple[FrequencyResponse, ...] = ()
    lines: Mapping[str, LineNoise] = field(default_factory=dict)
    error_ladder: tuple[ErrorStep, ...] = ()
    noise_floor: float = 0.0

    @property
    def error(self) -> float:
        """Rms residual of the scored runs, the last step of the error ladder [response]."""
        return self.error_ladder[-1].error


def compare_model(found: ModelResiduals, which: Which) -> Comparison:
    """Compare the runs with one of the two models, as `diagnosis.comparison` does with a given model."""
    model = found.before if which == "calibrated" else found.model
    responses = join_halves(found.responses, found.residuals_by_run[which], found.lines) if found.responses else ()
    if not found.runs:
        return Comparison(model, found.axis, (), found.noise, (), (), responses)
    runs = compared_runs(found, which)
    residuals, predicted = ({run.name: getattr(run, of) for run in runs} for of in ("residual", "predicted"))
    return Comparison(
        model=model,
        axis=found.axis,
        runs=runs,
        noise=found.noise,
        where=where(residuals, found.runs, predicted, found.noise),
        observed=tuple(found.runs),
        responses=responses,
    )


def compared_runs(found: ModelResiduals, which: Which) -> tuple[RunComparison, ...]:
    """Return measurement and prediction of each run by one model, see `compare_model`."""
    if not found.runs:
        return ()
    residuals, stroke = found.residuals_by_run[which], measured_stroke(found.runs, found.axis)
    return tuple(
        RunComparison(
            name=run.name,
            role=run.role,
            time=run.time,
            command=run.command(),
            measured=np.where(np.isfinite(residuals[run.name]), run.measured(), np.nan),
            predicted=_without_gaps(run.measured() - residuals[run.name]),
            noise_floor=found.noise.rms[run.name],
            stroke=stroke,
            remarks=tuple(run.remarks),
        )
        for run in found.runs
    )


def _without_gaps(values: Array) -> Array:
    """Return values with linear interpolation over their gaps, where position and velocity are needed, too."""
    is_present = np.isfinite(values)
    indices = np.arange(len(values), dtype=float)
    return np.asarray(np.interp(indices, indices[is_present], values[is_present]))


Verdict = Literal["nothing-missing", "effects-found", "unknown"]


@dataclass(frozen=True)
class Value:
    """The fitted value of a parameter with its 95 % interval.

    Parameters
    ----------
    parameter
        The parameter.
    value, interval
        Its value and the interval, SI.
    """

    parameter: Parameter
    value: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class IdentifiedEffect:
    """An effect that is named.

    Parameters
    ----------
    name
        Name of the effect.
    values
        Values of its parameters; for one that differs from run to run, the mean over the fitted runs.
    share
        Share of the unexplained mean square (above the noise) of the validation runs that the effect explains.
    by_run
        Its strength in each run, if it differs from run to run; else empty.
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
        Name of the effect, or of a pair of effects.
    present
        The effects that were already in the model.
    error
        Root mean square error of the validation runs [response].
    share
        Share of the previously unexplained mean square (above the noise) of the validation runs that it explains.
    evidence
        Fall of chi^2 over its critical value.
    outcome
        ``"added"``, or why it was not added.
    """

    names: tuple[str, ...]
    present: tuple[str, ...]
    error: float
    share: float
    evidence: float
    outcome: str


@dataclass(frozen=True, eq=False)
class Diagnosis(ModelResiduals):
    """The diagnosis of a stage model.

    Parameters
    ----------
    verdict
        Whether something is missing, and whether it is known.
    effects
        The named effects, in the order in which they were added.
    confusable
        Groups of effects that these runs do not distinguish; one of each group is among `effects`.
    possible_effects
        Effects that were added but are not named, each with the share that it explains of the mean square which
        calibration leaves unexplained.
    candidates
        All trials of the selection.
    calibration
        Fitted values of the parameters of the model itself.
    conflicts
        Parameters that moved by more than three standard deviations of their prior, in words.
    sparse_model
        Smooth functions that explain most of the residual of the last fit.
    remainder
        The residual above the noise, in words; empty if there is none.
    confidence
        Reasons that weaken the verdict, in words; empty if there are none.
    evaluations, seconds
        Number of predictions, and the time that the diagnosis took [s].
    remainder_rms
        Rms residual of the scored runs above the noise; zero if the model is adequate [response].
    stroke, tolerance
        Largest peak-to-peak reading of a run, and the change of a prediction that matters [response].
    undetermined
        Parameters that the runs do not determine, see `SelectionHistory`.
    refusals
        Why effects that were added are not named, in words, by their names.
    """

    verdict: Verdict
    effects: tuple[IdentifiedEffect, ...]
    confusable: tuple[tuple[str, ...], ...]
    possible_effects: Mapping[str, float]
    candidates: tuple[CandidateRecord, ...]
    calibration: tuple[Value, ...]
    conflicts: tuple[str, ...]
    sparse_model: SparseModel
    remainder: str
    confidence: str
    evaluations: int = 0
    seconds: float = 0.0
    remainder_rms: float = 0.0
    stroke: float = 0.0
    tolerance: float = 0.0
    undetermined: tuple[str, ...] = ()
    refusals: Mapping[str, str] = field(default_factory=dict)
