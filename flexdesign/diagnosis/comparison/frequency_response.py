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
from flexdesign.diagnosis.comparison.error_location import Breakdown, octaves, parts_of
from flexdesign.measurements.noise_level import LineNoise, allowed_excess
from flexdesign.measurements.recordings import FrequencyResponse
from flexdesign.measurements.recordings.run import Role


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
    def is_noise(self) -> bool:
        """Whether the error is noise, but for chance."""
        return self.ratio**2 - 1 <= allowed_excess(2 * int(self.validation.sum()), 0.0)


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
        halves.setdefault(each.name.removesuffix(":identify").removesuffix(":validate"), []).append(each)
    made = []
    for name, parts in halves.items():
        first, line_noise = parts[0], noise[parts[0].name]
        measured, predicted = (np.full(len(first.frequencies), np.nan + 0j) for _ in range(2))
        validation = np.zeros(len(measured), dtype=bool)
        for part in parts:
            real, imaginary = np.split(left[part.name], 2)
            measured[part.present] = part.response[part.present]
            predicted[part.present] = (part.response - real - 1j * imaginary)[part.present]
            validation |= part.present & (part.role == "validate" or len(parts) == 1)
        made.append(
            ResponseComparison(
                name=name,
                role=first.role if validation.all() else "validate",
                frequencies=first.frequencies,
                measured=measured,
                predicted=predicted,
                sigma=line_noise.sigma,
                coherence=first.coherence,
                validation=validation,
                known=line_noise.known,
                remarks=parts[-1].remarks,
            )
        )
    return tuple(made)


def by_band(responses: Sequence[ResponseComparison]) -> Breakdown:
    """Divide the unexplained error of frequency responses by bands: what the squares of errors have above the noise."""
    lowest = min(float(each.frequencies[0]) for each in responses)
    edges = octaves(lowest, max(float(each.frequencies[-1]) for each in responses))
    judging = [
        np.stack([e.frequencies, e.left**2, e.noise**2, np.ones(len(e.left))])[:, e.validation] for e in responses
    ]
    frequencies, *squares = np.concatenate(judging, axis=1)
    parts = parts_of(np.digitize(frequencies, edges[1:-1]), [*pairwise(edges)], *squares)
    return Breakdown("frequency", "Hz", parts)
