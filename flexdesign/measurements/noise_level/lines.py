"""The noise of a frequency response, line by line: from its coherence, else from how neighbouring lines scatter.

Of a response H that is the mean of n measurements with the coherence g2, both parts have the standard deviation
|H| sqrt((1 - g2) / (2 n g2)) (Bendat and Piersol, Random Data, 4th edition 2010, section 9.1.3: that of the magnitude
is the same, and so is that of the phase times the magnitude).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import digamma

from flexdesign.core.arrays import Array
from flexdesign.core.model import Observation
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Whitening
from flexdesign.measurements.noise_level.noise_floor import NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse

#: No line is known better than to this share of its size, nor to this share of the largest: analysers and their
#: calibration are no better.
OF_LINE, OF_LARGEST = 1e-4, 1e-6
#: A coherence of few measurements is uncertain: this number is averaged, over neighbouring lines.
TOGETHER = 64
#: Coherences below this are one: nothing is known of the line.
LOWEST = 1e-3
#: Without coherence: neighbouring lines whose scatter is taken together, so that its median is known to a quarter.
NEIGHBOURS = 15


@dataclass(frozen=True, eq=False)
class LineNoise:
    """The noise of one frequency response.

    Parameters
    ----------
    sigma
        Standard deviation of the real part and of the imaginary part of each line, n values [response/V].
    known
        Whether it follows from the coherence; else it is guessed from neighbouring lines.
    dof
        Effective number of values behind its level; zero where it is a guess.
    """

    sigma: Array
    known: bool
    dof: float

    @property
    def of_values(self) -> Array:
        """Standard deviation of each value of `FrequencyResponse.measured`, 2n values."""
        return np.tile(self.sigma, 2)


@dataclass(frozen=True)
class Mixed:
    """The noise of runs and of frequency responses, as a `Whitening`.

    Parameters
    ----------
    runs
        What whitens runs.
    lines
        The noise of each frequency response by its name.
    """

    runs: Whitening
    lines: Mapping[str, LineNoise]

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual, see `Whitening`."""
        if observation.name not in self.lines:
            return self.runs.whiten(observation, residual)
        return np.asarray(residual / self.lines[observation.name].of_values[:, None])


def line_noise(response: FrequencyResponse) -> LineNoise:
    """Return the noise of a frequency response with all its lines."""
    size = np.abs(response.response)
    floor = np.maximum(OF_LINE * size, OF_LARGEST * size.max())
    if response.coherence is not None and response.averages is not None:
        count = response.averages
        share = np.maximum(response.coherence, LOWEST)
        variance = size**2 * (1 - share) / (2 * count * share)
        width = min(math.ceil(TOGETHER / max(count - 1, 1)), len(size)) | 1
        # Logarithms, as both a flat noise and one that grows with the response are then smooth compared with a
        # resonance.
        variance = np.exp(uniform_filter1d(np.log(np.maximum(variance, floor**2)), width, mode="nearest"))
        # The response itself took one measurement of n; and the logarithm of a chi-square is low on average.
        left = max(count - 1, 1)
        variance = variance * (count / left) * left / math.exp(float(digamma(left)))
        dof = float(2 * (count - 1) * len(size))
        return LineNoise(np.sqrt(np.maximum(variance, floor**2)), True, max(dof, 1.0))
    sigma = np.maximum(_line_scatter(response), floor)
    # What a model lacks is a share of the response, which a guess does not know: quiet lines far below a resonance
    # would outvote it. None counts more than those within half the power of the highest peak.
    highest = size >= size.max() / math.sqrt(2)
    return LineNoise(np.maximum(sigma, float(np.median(sigma[highest] / size[highest])) * size), False, 0.0)


def _line_scatter(response: FrequencyResponse) -> Array:
    """Return how far lines are from the curve through their neighbours, as a standard deviation of each part.

    The response itself bends, most at a resonance, so that this is too large rather than too small.
    """
    x, values = np.log(response.frequencies), response.response
    squares = np.empty(len(x))
    for k in range(len(x)):
        first = min(max(k - 2, 0), len(x) - 5)
        at = np.arange(first, first + 5)
        # Weights that take out a cubic through unevenly spaced lines: those of the fourth divided difference.
        gaps = x[at][:, None] - x[at][None, :] + np.eye(5)
        weights = 1 / np.prod(gaps, axis=1)
        squares[k] = abs(weights @ values[at]) ** 2 / (weights @ weights)
    median = 2 * math.log(2)  # of a chi-square with two degrees of freedom
    if response.coherence is not None:  # how the noise goes from line to line, if not how large it is
        share = np.clip(response.coherence, LOWEST, 1 - 1e-9)
        shape = np.abs(values) * np.sqrt((1 - share) / share)
        return np.asarray(shape * math.sqrt(float(np.median(squares / shape**2)) / median))
    half = NEIGHBOURS // 2
    local = [np.median(squares[max(k - half, 0) : k + half + 1]) for k in range(len(x))]
    return np.sqrt(np.array(local) / median)


def noise_of_lines(responses: Sequence[FrequencyResponse], lines: Mapping[str, LineNoise]) -> NoiseFloor:
    """Return the noise of frequency responses as that of runs is said, each line weighted [response/V]."""
    known = all(lines[each.name].known for each in responses)
    records = {each.name.rpartition(":")[0] or each.name: lines[each.name].dof for each in responses}
    source = "coherence and averages" if known else "unknown"
    return NoiseFloor(
        ColouredNoise({}), weighted_rms(responses, lines), source, known, (), sum(records.values()) if known else 0.0
    )


def with_lines(noise: NoiseFloor, responses: Sequence[FrequencyResponse], lines: Mapping[str, LineNoise]) -> NoiseFloor:
    """Return the noise of runs with that of frequency responses, which has names of its own."""
    if not responses:
        return noise
    known = noise.known and all(lines[each.name].known for each in responses)
    return replace(noise, rms={**noise.rms, **weighted_rms(responses, lines)}, known=known)


def weighted_rms(responses: Sequence[FrequencyResponse], noise: Mapping[str, LineNoise]) -> dict[str, float]:
    """Return the rms noise of the lines that are looked at, each weighted by 1 / sigma^2, by name [response/V]."""
    return {each.name: float(np.mean(noise[each.name].sigma[each.present] ** -2.0) ** -0.5) for each in responses}
