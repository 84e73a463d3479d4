"""The remainder of a fitted model: its residual compared with the noise, and described in words."""

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
    """The residual of a fitted model compared with the noise.

    Parameters
    ----------
    excess
        Mean square of the whitened residual, less that of noise (one): the larger of fitted and validation runs.
    allowed
        Largest excess that counts as noise.
    jumps
        Number of sudden changes in the whitened residual of the fitted runs.
    """

    excess: float
    allowed: float
    jumps: int = 0

    @property
    def is_noise(self) -> bool:
        """Tell whether the residual is noise."""
        return self.excess <= self.allowed and self.jumps < FEWEST_JUMPS


def remainder(data: DiagnosisData, fit: FittedModel) -> Remainder:
    """Return the residual of a fitted model compared with the noise."""
    margins = [(ratio - 1, allowed_excess(count, level)) for ratio, count, level in _ratios(data, fit)]
    excess, allowed = max(margins, key=lambda pair: pair[0] - pair[1])
    return Remainder(excess, allowed, _jumps(data, fit))


def _ratios(data: DiagnosisData, fit: FittedModel) -> Iterator[tuple[float, int, float]]:
    """Yield mean squares of the whitened residual, their numbers of values, and twice the relative error of the noise.

    Runs and frequency responses are compared separately: frequency responses have few values, which would not count
    among those of runs.
    """
    level = 2 * data.noise.relative_error
    pairs = list(zip(fit.solution.problem.dataset.records, fit.solution.residuals, strict=True))
    kinds = [(level, [pair for pair in pairs if pair[0].observation.name not in data.lines])]
    kinds += [(_line_level(data), [pair for pair in pairs if pair[0].observation.name in data.lines])]
    for error, fitted in kinds:
        if count := int(sum(record.present.sum() for record, _ in fitted)):
            yield sum(float(part @ part) for _, part in fitted) / count, count, error
    chi2_of_lines = 0.0
    scored = [each for each in data.responses if each.role == "validate"]
    if scored:
        whitened = [
            (fit.residuals_by_run[e.name] / data.lines[e.name].of_values)[np.tile(e.present, 2)] for e in scored
        ]
        chi2_of_lines = float(sum(part @ part for part in whitened))
        values = sum(len(part) for part in whitened)
        yield chi2_of_lines / values, values, _line_level(data)
    if samples := sum(int(np.isfinite(run.measured()).sum()) for run in data.of("validate")):
        yield (fit.validation_chi2 - chi2_of_lines) / samples, samples, level


def _line_level(data: DiagnosisData) -> float:
    """Return twice the relative error of the noise of frequency responses."""
    return max((math.sqrt(2 / noise.dof) if noise.dof else math.inf for noise in data.lines.values()), default=0.0)


def _jumps(data: DiagnosisData, fit: FittedModel) -> int:
    """Count the jumps in the residual; a reading in coarse steps has jumps by itself, which do not count."""
    if data.coarse_step is not None:
        return 0
    count = 0
    for record, part in zip(fit.solution.problem.dataset.records, fit.solution.residuals, strict=True):
        if record.observation.name in data.lines:  # neighbouring lines are no neighbours in time
            continue
        sizes = np.abs(part[: len(record.measured)][record.present])
        count += int((sizes > JUMP_DEVIATIONS * DEVIATION_PER_MEDIAN * np.median(sizes)).sum())
    return count


def unexplained_rms(data: DiagnosisData, fit: FittedModel) -> float:
    """Return the rms residual of the scored runs above the noise [response]; all of it if the noise is unknown."""
    return math.sqrt(max(data.error(fit) ** 2 - data.known_noise_rms**2, 0.0))


def is_negligible(data: DiagnosisData, fit: FittedModel) -> bool:
    """Return whether what is unexplained is below a stated tolerance, or below the usual one if noise is unknown."""
    return (data.is_asked or not data.noise.known) and unexplained_rms(data, fit) <= data.tolerance


def is_adequate(data: DiagnosisData, fit: FittedModel, smooth_model: SparseModel) -> bool:
    """Return whether the residual is noise, or below the tolerance that the user stated."""
    if is_negligible(data, fit):
        return True
    # Smooth functions that explain a part of the residual show that it is not noise, however small that part is.
    explainable = smooth_model.held_gain > 0 and smooth_model.validation_rms > data.tolerance and smooth_model.gain > 0
    if not data.noise.known:  # a white residual may be noise, whatever its size
        return fit.is_white and not explainable
    return remainder(data, fit).is_noise and not explainable


def describe_size(data: DiagnosisData, final: Remainder) -> str:
    """Return the size of a remainder, in words."""
    if not data.noise.known:
        return "the residual remains"
    return f"{math.sqrt(1 + max(final.excess, 0.0)):.3g} times the noise remains"


def describe(data: DiagnosisData, final: Remainder, smooth_model: SparseModel) -> str:
    """Return the size of a remainder, and the smooth functions that explain most of it, in words."""
    share = describe_size(data, final)
    if data.noise.known and any(data.noise.whitening.process(run.name).order for run in data.runs):
        share += " (whitened: of each sample counts what those before it do not predict; the errors stated are raw)"
    if final.jumps >= FEWEST_JUMPS:
        share += f", with {final.jumps} sudden jumps"
    if not smooth_model.terms:
        return f"{share}; no smooth function of position, velocity, voltage or time explains it"
    best = sorted(smooth_model.shares, key=lambda name: -smooth_model.shares[name])[:3]
    return f"{share}; of smooth functions these explain most: {', '.join(best)}"
