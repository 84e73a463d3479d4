"""Residuals of a diagnosis: of the calibrated model without further effects, and with the identified effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from flexdesign.diagnosis.comparison import Comparison, RunComparison, join_halves, where
from flexdesign.dynamics.axis.axis_run import measured_stroke
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements.noise_level import LineNoise, NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run

Array = NDArray[np.float64]
Which = Literal["calibrated", "found"]


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
    """

    axis: str
    before: StageModel
    model: StageModel
    runs: tuple[Run, ...]
    noise: NoiseFloor
    residuals_by_run: Mapping[str, Mapping[str, object]] = field(repr=False)
    responses: tuple[FrequencyResponse, ...] = ()
    lines: Mapping[str, LineNoise] = field(default_factory=dict)


def compare_model(found: ModelResiduals, which: Which) -> Comparison:
    """Compare the runs with one of the two models, as `diagnosis.comparison` does for a model as it is.

    Parameters
    ----------
    found
        A diagnosis or an addition.
    which
        ``"calibrated"`` without further effects, ``"found"`` with them.
    """
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
