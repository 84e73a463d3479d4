"""How a model stands beside the runs in a diagnosis: calibrated without further effects, and with what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from flexdesign.diagnosis.comparison import Comparison, RunComparison, joined, where
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements.noise_level import LineNoise, NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run

Array = NDArray[np.float64]
Which = Literal["calibrated", "found"]


class ModelResiduals(Protocol):
    """What a diagnosis and an addition have in common: runs, and their residuals before and after."""

    @property
    def axis(self) -> str:
        """The axis that was looked at."""

    @property
    def before(self) -> StageModel:
        """The stage model as it was."""

    @property
    def model(self) -> StageModel:
        """The stage model with what was found."""

    @property
    def runs(self) -> Sequence[Run]:
        """The runs with their roles, as the axis sees them."""

    @property
    def responses(self) -> Sequence[FrequencyResponse]:
        """The frequency responses with their roles."""

    @property
    def lines(self) -> Mapping[str, LineNoise]:
        """The noise of each of these, by name."""

    @property
    def noise(self) -> NoiseFloor:
        """The noise floor."""

    @property
    def residuals_by_run(self) -> Mapping[str, Mapping[str, object]]:
        """Measured less predicted by stand and run, with what the start of each record explains taken out."""


def compared(found: ModelResiduals, which: Which) -> Comparison:
    """Return the runs beside one of the two models, as `diagnosis.comparison` does for a model as it is.

    Parameters
    ----------
    found
        A diagnosis or an addition.
    which
        ``"calibrated"`` without further effects, ``"found"`` with them.
    """
    left = cast("Mapping[str, Array]", found.residuals_by_run[which])
    model = found.before if which == "calibrated" else found.model
    responses = joined(found.responses, left, found.lines) if found.responses else ()
    if not found.runs:
        return Comparison(model, found.axis, (), found.noise, (), (), 0.0, responses)
    stroke = max(float(np.nanmax(run.measured()) - np.nanmin(run.measured())) for run in found.runs)
    predicted = {run.name: _without_gaps(run.measured() - left[run.name]) for run in found.runs}
    runs = tuple(
        RunComparison(
            name=run.name,
            role=run.role,
            time=run.time,
            command=run.command(),
            measured=np.where(np.isfinite(left[run.name]), run.measured(), np.nan),
            predicted=predicted[run.name],
            noise_floor=found.noise.rms[run.name],
            stroke=stroke,
            remarks=tuple(run.remarks),
        )
        for run in found.runs
    )
    return Comparison(
        model=model,
        axis=found.axis,
        runs=runs,
        noise=found.noise,
        where=where({run.name: run.residual for run in runs}, found.runs, predicted, found.noise),
        observed=tuple(found.runs),
        seconds=0.0,
        responses=responses,
    )


def _without_gaps(values: Array) -> Array:
    """Return values with straight lines over their gaps: position and velocity are needed there, too."""
    there = np.isfinite(values)
    places = np.arange(len(values), dtype=float)
    return np.asarray(np.interp(places, places[there], values[there]))
