"""A stage model compared with measured frequency responses: the error of each line, its noise, and the band.

Errors are relative to the measured line, as a Bode picture shows them: a resonance is not worse for being large.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexdesign.core.arrays import Array, Complex, Flags
from flexdesign.diagnosis.comparison.error_location import Breakdown, Part
from flexdesign.measurements.noise_level import LineNoise
from flexdesign.measurements.recordings import FrequencyResponse
from flexdesign.measurements.recordings.run import Role

#: Bands of even ratios, no more than these and none with fewer lines than that on average.
MOST_BANDS, FEWEST_LINES = 8, 5


@dataclass(frozen=True, eq=False)
class ResponseComparison:
    """How well the model predicts one frequency response.

    Parameters
    ----------
    name, role
        Of the response; of one whose lines are split the role is ``validate``.
    frequencies
        n lines [Hz].
    measured, predicted
        n complex numbers each [response/V].
    sigma
        Standard deviation of each part of each line [response/V].
    coherence
        n numbers; None if it was not recorded.
    validation
        Which lines judge: validation lines, or all.
    known
        Whether the noise is known.
    remarks
        What to keep in mind about it.
    """

    name: str
    role: Role
    frequencies: Array
    measured: Complex
    predicted: Complex
    sigma: Array
    coherence: Array | None
    validation: Flags
    known: bool
    remarks: tuple[str, ...]

    @property
    def left(self) -> Array:
        """Size of measured less predicted over the measured size, line by line."""
        return np.asarray(np.abs(self.measured - self.predicted) / np.abs(self.measured))

    @property
    def noise(self) -> Array:
        """What noise gives of it, line by line."""
        return np.asarray(math.sqrt(2) * self.sigma / np.abs(self.measured))

    @property
    def rms(self) -> float:
        """Root mean square of `left` over the lines that judge, a ratio."""
        return float(np.sqrt(np.mean(self.left[self.validation] ** 2)))

    @property
    def noise_floor(self) -> float:
        """The same of the noise."""
        return float(np.sqrt(np.mean(self.noise[self.validation] ** 2)))

    @property
    def ratio(self) -> float:
        """Root mean square of the error over the noise, line by line: one where nothing but noise is left."""
        return float(np.sqrt(np.mean((self.left / self.noise)[self.validation] ** 2)))

    @property
    def worst(self) -> float:
        """The frequency at which it is largest [Hz]."""
        return float(self.frequencies[self.validation][np.argmax(self.left[self.validation])])


def compared_lines(
    response: FrequencyResponse, predicted: Complex, noise: LineNoise, validation: Flags | None = None
) -> ResponseComparison:
    """Compare a measured response with a predicted one."""
    return ResponseComparison(
        response.name,
        response.role if validation is None or validation.all() else "validate",
        response.frequencies,
        response.response,
        predicted,
        noise.sigma,
        response.coherence,
        np.ones(len(predicted), dtype=bool) if validation is None else validation,
        noise.known,
        response.remarks,
    )


def join_halves(
    responses: Sequence[FrequencyResponse], left: Mapping[str, Array], noise: Mapping[str, LineNoise]
) -> tuple[ResponseComparison, ...]:
    """Return frequency responses and the residuals of a fit; both halves of one are joined.

    Parameters
    ----------
    responses
        With roles, perhaps in halves, see `flexdesign.measurements.recordings.split_lines`.
    left
        Measured less predicted, by name: 2n values, the real parts first.
    noise
        Of each, by name.
    """
    halves: dict[str, list[FrequencyResponse]] = {}
    for each in responses:
        split = each.name.endswith((":identify", ":validate"))
        halves.setdefault(each.name.rpartition(":")[0] if split else each.name, []).append(each)
    made = []
    for name, parts in halves.items():
        measured, predicted = (np.full(len(parts[0].frequencies), np.nan + 0j) for _ in range(2))
        validation = np.zeros(len(measured), dtype=bool)
        for part in parts:
            there, count = part.present, len(part.frequencies)
            rest = left[part.name][:count] + 1j * left[part.name][count:]
            measured[there], predicted[there] = part.response[there], (part.response - rest)[there]
            validation |= there if part.role == "validate" or len(parts) == 1 else False
        whole = FrequencyResponse(
            name, parts[0].frequencies, measured, role=parts[0].role, coherence=parts[0].coherence,
            remarks=parts[-1].remarks,
        )  # fmt: skip
        made.append(compared_lines(whole, predicted, noise[parts[0].name], validation))
    return tuple(made)


def by_band(responses: Sequence[ResponseComparison]) -> Breakdown:
    """Divide the unexplained error of frequency responses by bands: what the squares of errors have above the noise."""
    low = min(float(each.frequencies[0]) for each in responses)
    high = max(float(each.frequencies[-1]) for each in responses)
    lines = max(len(each.frequencies) for each in responses)
    edges = np.geomspace(low, high, min(max(lines // FEWEST_LINES, 1), MOST_BANDS) + 1)
    judging = [(e.frequencies[e.validation], e.left[e.validation] ** 2, e.noise[e.validation] ** 2) for e in responses]
    frequencies, squares, noise = map(np.concatenate, zip(*judging, strict=True))
    places = np.clip(np.searchsorted(edges, frequencies, side="right") - 1, 0, len(edges) - 2)
    counts, total, noise = (np.bincount(places, weights, len(edges) - 1) for weights in (None, squares, noise))
    excess = np.maximum(total - noise, 0.0)
    parts = tuple(
        Part("", first, last, float(e / (excess.sum() or 1.0)), float(c / counts.sum()), math.sqrt(s / c) if c else 0.0)
        for (first, last), e, c, s in zip(pairwise(edges.tolist()), excess, counts, total, strict=True)
    )
    return Breakdown("frequency", "Hz", parts)
