"""A stage model compared with recorded runs: the error of each against its noise floor, and where it lies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.comparison.error_location import Breakdown
from flexdesign.diagnosis.comparison.frequency_response import ResponseComparison
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.criterion import LARGE
from flexdesign.measurements.noise_level import NoiseFloor, allowed_excess
from flexdesign.measurements.recordings import FrequencyResponse, Role, Run


@dataclass(frozen=True, eq=False)
class RunComparison:
    """How well the model predicts one run.

    Parameters
    ----------
    name, role
        Of the run.
    time, command, measured, predicted
        n values each [s], [V], [response]; the offset of the run is added to the prediction. `measured` is NaN where
        it was not compared.
    noise_floor
        Standard deviation of the noise [response].
    stroke
        What the response covers in all runs together, the largest span of a run [response].
    remarks
        What to keep in mind about this run.
    offset_rms
        Rms residual if nothing but the offset of the run is fitted; None if that is what the residual is [response].
    """

    name: str
    role: Role
    time: Array
    command: Array
    measured: Array
    predicted: Array
    noise_floor: float
    stroke: float
    remarks: tuple[str, ...]
    offset_rms: float | None = None

    @property
    def residual(self) -> Array:
        """Measured less predicted [response]; NaN where it was not compared."""
        return self.measured - self.predicted

    @property
    def rms(self) -> float:
        """Root mean square of the residual [response]."""
        return float(np.sqrt(np.nanmean(self.residual**2)))

    @property
    def largest(self) -> float:
        """Largest residual, without its sign [response]."""
        return float(np.nanmax(np.abs(self.residual)))

    @property
    def of_stroke(self) -> float:
        """The root mean square over the stroke, a ratio; NaN if nothing moved."""
        return self.rms / self.stroke if self.stroke else math.nan

    @property
    def r2(self) -> float:
        """Share of the measured variance that the model explains; NaN if the command never moved."""
        variance = float(np.nanvar(self.measured))
        return 1 - self.rms**2 / variance if variance and np.ptp(self.command) else math.nan

    @property
    def ratio(self) -> float:
        """The root mean square over the noise floor."""
        return self.rms / self.noise_floor


@dataclass(frozen=True, eq=False)
class Comparison:
    """A stage model and what runs say against it.

    Parameters
    ----------
    model, axis
        The model, and which of its axes.
    runs
        In the order given.
    noise
        The noise floor.
    where
        The unexplained error by run, frequency and operating region.
    observed
        The runs as the axis sees them, with gaps where they cannot be compared.
    responses
        Frequency responses, in the order given.
    """

    model: StageModel
    axis: str
    runs: tuple[RunComparison, ...]
    noise: NoiseFloor
    where: tuple[Breakdown, ...]
    observed: tuple[Run, ...]
    responses: tuple[ResponseComparison, ...] = ()

    def __post_init__(self) -> None:
        where = (replace(b, si=self.response) if b.by == "position" else b for b in self.where)
        object.__setattr__(self, "where", tuple(where))  # positions are written as the model says

    @property
    def response(self) -> str:
        """SI unit of the response, which knows in which units it is written."""
        return self.model.axes[self.axis].response_units

    @property
    def rms(self) -> float:
        """Root of the mean square over runs, each counting the same [response]; NaN without runs."""
        return math.sqrt(np.mean([run.rms**2 for run in self.runs])) if self.runs else math.nan

    @property
    def floor(self) -> float:
        """The same of the noise [response]."""
        return math.sqrt(np.mean([run.noise_floor**2 for run in self.runs])) if self.runs else math.nan

    @property
    def unexplained(self) -> float:
        """Root of the mean square above the noise floor [response]; zero where the error is noise."""
        return math.sqrt(max(self.rms**2 - self.floor**2, 0.0))

    @property
    def is_noise(self) -> bool:
        """Whether the error of the runs is noise, but for chance; False without runs."""
        count = sum(int(np.isfinite(run.residual).sum()) for run in self.runs)
        level = 2 * self.noise.relative_error if self.noise.known else 0.0
        return bool(self.runs) and (self.rms / self.floor) ** 2 - 1 <= allowed_excess(count, level)

    @property
    def agrees(self) -> bool:
        """Whether the errors of runs and frequency responses are noise: then nothing is missing."""
        return (self.is_noise or not self.runs) and all(each.is_noise for each in self.responses)

    def by(self, what: str) -> Breakdown | None:
        """Return the breakdown by one thing; None if these runs do not show it."""
        return next((breakdown for breakdown in self.where if breakdown.by == what), None)


def compare_run(dynamics: AxisDynamics, run: Run, noise_floor: float) -> RunComparison:
    """Compare a run, as its axis sees it, with a prediction, the offset of the sensor removed, where both compare.

    What a mode did before the record began is unknown: until it has decayed, the run is not compared.

    Raises
    ------
    InputError
        If the run holds no reading, or the prediction is not finite.
    """
    measured, predicted = dynamics.comparable(run).measured(), dynamics.predict(run)
    there = np.isfinite(measured)
    if not there.any():
        raise InputError(run.name, dynamics.name, None, "the run holds no reading that can be compared; leave it out")
    if not np.all(np.isfinite(predicted)):
        remedy = "the model's response grows without bound in this run; check its damping and its effects"
        raise InputError(run.name, dynamics.name, None, remedy)
    predicted = predicted + float(np.mean((measured - predicted)[there]))
    stroke, remarks = float(np.ptp(measured[there])), remarks_of(dynamics, run)
    if skipped := dynamics.unknown_start(run):
        began = "the command was moving when the recording began"
        remarks = (*remarks, f"{began}: the first {skipped * run.period:.3g} s are not compared")
    return RunComparison(run.name, run.role, run.time, run.command(), measured, predicted, noise_floor, stroke, remarks)


def remarks_of(dynamics: AxisDynamics, run: Run) -> tuple[str, ...]:
    """Return what to keep in mind about a run: what else moved, and what the limits of the model cut off."""
    remarks = list(run.remarks)
    others = [name for name in run.commands if name not in ("u", f"u{dynamics.name}") and np.ptp(run.columns[name])]
    if others:
        remarks.append(f"{' and '.join(others)} moved too; what that does to this axis is left in the residual")
    cut = dynamics.cut(run)
    if cut > 0:
        remarks.append(f"the command goes up to {cut:.3g} V beyond the limits of the model, which cut it off")
    return tuple(remarks)


# --- reversed signs --------------------------------------------------------------------------------------------------


def correlation(runs: Iterable[tuple[Array, Array]]) -> float:
    """Return the correlation of measured and predicted motion of runs, about the mean of each; NaN if nothing moves.

    >>> t = np.linspace(0, 20, 500)
    >>> round(correlation([(np.sin(t), -2 * np.sin(t)), (np.cos(t) + 5, -np.cos(t))]), 3)
    -1.0
    """
    squares = np.zeros((2, 2))
    for pair in map(np.stack, runs):
        seen = pair[:, np.isfinite(pair).all(axis=0)]
        if seen.size:
            squares += len(seen.T) * np.cov(seen, bias=True)
    size = math.sqrt(squares[0, 0] * squares[1, 1])
    return float(squares[0, 1] / size) if size else math.nan


def reversal_doubt(runs: Sequence[Run], responses: Sequence[FrequencyResponse], residuals: Mapping[str, Array]) -> str:
    """Return what to ask if the reversed prediction explains more than half of the motion; empty if it does not.

    Of runs it is the correlation that decides, by their residuals [response]. Of frequency responses, it is the mean
    cosine of the phase between measured and predicted lines, whatever their size.
    """
    moving = [run for run in runs if run.name in residuals and np.ptp(run.command())]
    agreements = [correlation((run.measured(), run.measured() - residuals[run.name]) for run in moving)]
    cosines = list[Array]()
    for each in responses:
        real, imaginary = np.split(each.measured() - residuals[each.name], 2)
        both = each.response * (real - 1j * imaginary)
        cosines.append(np.cos(np.angle(both[each.present & (both != 0)])))
    if cosines:
        agreements.append(float(np.mean(np.concatenate(cosines))))
    for found in agreements:
        if found < 0 and LARGE * (1 - found**2) < 1:
            return (
                f"the stage moves against the prediction (correlation {found:.2f}): is the sign of the gain, of the "
                "command or of the response reversed, or the natural frequency wrong about which they are driven"
            )
    return ""
