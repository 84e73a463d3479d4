"""Spectra of a command and of what follows it, averaged over segments of records (Welch 1967)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array, Complex


@dataclass(frozen=True, eq=False)
class CrossSpectra:
    """Averaged spectra of a command and of a signal.

    Parameters
    ----------
    frequencies
        n of them [Hz].
    command, signal
        Their power densities, n values each.
    across
        Density of their cross spectrum, n complex values.
    segments
        Number of segments that were averaged.
    """

    frequencies: Array
    command: Array
    signal: Array
    across: Complex
    segments: int

    @property
    def coherence(self) -> Array:
        """The share of the signal that follows the command linearly, n values; NaN where the command has no power."""
        product = np.maximum(self.command * self.signal, 1e-300)
        return np.where(self.command > 1e-9 * self.command.max(), np.abs(self.across) ** 2 / product, np.nan)

    @property
    def coherent_power(self) -> Array:
        """The density of what in the signal follows the command, n values; 0 where the command has no power."""
        return np.asarray(np.nan_to_num(self.coherence) * self.signal)

    def exceeded_by_chance(self, probability: float) -> float:
        """Return the coherence that unrelated signals exceed with a probability (Carter, Knapp and Nuttall 1973)."""
        return float(1 - probability ** (1 / max(self.segments - 1, 1)))


def cross_spectra(pairs: Sequence[tuple[Array, Array]], period: float, length: int) -> CrossSpectra:
    """Return the spectra of commands and signals, averaged over all segments of all records.

    Parameters
    ----------
    pairs
        Command and signal of each record, at least `length` values each; gaps of the signal are NaN, and count as zero.
    period
        Of the samples of all records [s].
    length
        Samples of a segment; half of them are in the next one, too.
    """
    from scipy.signal import csd

    total, segments, frequencies = np.zeros((3, length // 2 + 1), dtype=complex), 0, np.zeros(0)
    for command, signal in pairs:
        u, s = command - command.mean(), np.nan_to_num(signal)
        count = max((len(u) - length // 2) // (length - length // 2), 1)
        for row, (a, b) in enumerate(((u, u), (s, s), (u, s))):
            frequencies, density = csd(a, b, fs=1 / period, nperseg=length)
            total[row] += count * density
        segments += count
    return CrossSpectra(frequencies, total[0].real / segments, total[1].real / segments, total[2] / segments, segments)
