"""What a fitted model leaves unexplained, compared with the noise and with what matters, and what it looks like."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.sparse_residual_model import SparseModel
from flexdesign.measurements.noise_level import allowed_excess

#: A sample this number of standard deviations of its run from zero is a jump; this number of jumps is not random: in
#: Gaussian noise one sample in five hundred million lies as far.
JUMP_DEVIATIONS, FEWEST_JUMPS = 6.0, 3
#: Standard deviation of Gaussian noise over the median of its size.
DEVIATION_PER_MEDIAN = 1.4826


@dataclass(frozen=True)
class Remainder:
    """How a fitted model's remainder compares with the noise.

    Parameters
    ----------
    excess
        Mean square of the residual, whitened, less that of noise: the larger one of fitted and
        validation runs.
    allowed
        What counts as none.
    jumps
        Sudden changes in the residual, whitened, of the runs that were fitted.
    """

    excess: float
    allowed: float
    jumps: int = 0

    @property
    def is_noise(self) -> bool:
        """Tell whether nothing but noise is left."""
        return self.excess <= self.allowed and self.jumps < FEWEST_JUMPS


def remainder(data: DiagnosisData, fit: FittedModel) -> Remainder:
    """Return how what a fitted model leaves compares with the noise."""
    margins = [(ratio - 1, allowed_excess(count, level)) for ratio, count, level in _ratios(data, fit)]
    excess, allowed = max(margins, key=lambda pair: pair[0] - pair[1])
    return Remainder(excess, allowed, _jumps(data, fit))


def _ratios(data: DiagnosisData, fit: FittedModel) -> Iterator[tuple[float, int, float]]:
    """Yield mean squares of the residual, whitened, with their counts and twice the relative error of the noise.

    Runs and frequency responses are judged apart: these have so few values that they would drown among those.
    """
    level = 2 * data.noise.relative_error
    pairs = list(zip(fit.solution.problem.dataset.records, fit.solution.residuals, strict=True))
    kinds = [(level, [pair for pair in pairs if pair[0].observation.name not in data.lines])]
    kinds += [(_line_level(data), [pair for pair in pairs if pair[0].observation.name in data.lines])]
    for error, seen in kinds:
        if count := int(sum(record.present.sum() for record, _ in seen)):
            yield sum(float(part @ part) for _, part in seen) / count, count, error
    held = 0.0
    scored = [each for each in data.responses if each.role == "validate"]
    if scored:
        left = [(fit.residuals_by_run[e.name] / data.lines[e.name].of_values)[np.tile(e.present, 2)] for e in scored]
        held = float(sum(part @ part for part in left))
        values = sum(len(part) for part in left)
        yield held / values, values, _line_level(data)
    if samples := sum(int(np.isfinite(run.measured()).sum()) for run in data.of("validate")):
        yield (fit.validation_chi2 - held) / samples, samples, level


def _line_level(data: DiagnosisData) -> float:
    """Return twice the relative error of the noise of frequency responses."""
    return max((math.sqrt(2 / noise.dof) if noise.dof else math.inf for noise in data.lines.values()), default=0.0)


def _jumps(data: DiagnosisData, fit: FittedModel) -> int:
    """Count the jumps in the residual; a reading in coarse steps has them by itself."""
    if data.coarse_step is not None:
        return 0
    count = 0
    for record, part in zip(fit.solution.problem.dataset.records, fit.solution.residuals, strict=True):
        if record.observation.name in data.lines:  # neighbouring lines are no neighbours in time
            continue
        left = np.abs(part[: len(record.measured)][record.present])
        count += int((left > JUMP_DEVIATIONS * DEVIATION_PER_MEDIAN * np.median(left)).sum())
    return count


def unexplained_rms(data: DiagnosisData, fit: FittedModel) -> float:
    """Return the rms residual above the noise of the runs that judge [response]; all of it where that is unknown."""
    return math.sqrt(max(data.error(fit) ** 2 - data.known_noise_rms**2, 0.0))


def is_adequate(data: DiagnosisData, fit: FittedModel, left: SparseModel) -> bool:
    """Return whether the residual is noise, or below what matters to the user."""
    if (data.is_asked or not data.noise.known) and unexplained_rms(data, fit) <= data.tolerance:
        return True
    # Smooth functions that explain something show that there is something, however small it is compared with the noise.
    explainable = left.held_gain > 0 and left.validation_rms > data.tolerance and left.gain > 0
    if not data.noise.known:  # a white residual may be noise, whatever its size
        return fit.is_white and not explainable
    return remainder(data, fit).is_noise and not explainable


def describe_unnamed(data: DiagnosisData, final: Remainder, adequate: FittedModel) -> str:
    """Return how much the named effects leave where others explain it with numbers at the end of what is plausible."""
    share = f"{_size(data, final)}; {' and '.join(adequate.names)} would explain it"
    ends = adequate.at_bound()
    return f"{share} with {' and '.join(ends)} at the end of what is plausible" if ends else share


def _size(data: DiagnosisData, final: Remainder) -> str:
    if not data.noise.known:
        return "the residual remains"
    return f"{math.sqrt(1 + max(final.excess, 0.0)):.3g} times the noise remains"


def describe(data: DiagnosisData, final: Remainder, left: SparseModel) -> str:
    """Return how much a model leaves, and which smooth functions explain most of it."""
    share = _size(data, final)
    if data.noise.known and any(data.noise.whitening.process(run.name).order for run in data.runs):
        share += " (whitened: of each sample counts what those before it do not predict; the errors stated are raw)"
    if final.jumps >= FEWEST_JUMPS:
        share += f", with {final.jumps} sudden jumps"
    if not left.terms:
        return f"{share}; no smooth function of position, velocity, voltage or time explains it"
    best = sorted(left.shares, key=lambda name: -left.shares[name])[:3]
    return f"{share}; of smooth functions these explain most: {', '.join(best)}"
