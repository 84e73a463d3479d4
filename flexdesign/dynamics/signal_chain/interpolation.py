"""A measured smooth command between its samples: interpolation of a band-limited signal by its derivatives.

A command without content near the Nyquist frequency is determined by its samples. A straight line between them is
wrong by (w h)^2 / 12 of a sine, 4 % at nine samples in a period; the cubic with the right derivatives at the samples is
wrong by (w h)^4 / 720 on average, 0.04 % there. The derivatives come from the ideal differentiator, (-1)^m / m
at a distance of m samples, within a window of Kaiser (Oppenheim and Schafer, Discrete-Time Signal Processing,
section 7.5).
"""

from __future__ import annotations

import numpy as np

from flexdesign.core.arrays import Array

#: Samples to each side from which a derivative is estimated; and the window's shape: derivatives are right within 5e-4
#: from a twentieth to four fifths of the Nyquist frequency, and below within 5e-4 of what they are at its tenth.
REACH, SHAPE = 16, 9.0


def derivatives(samples: Array) -> Array:
    """Return the slope at each sample of a band-limited signal, n values per sampling period.

    Beyond both ends the signal is taken to go on point-symmetrically.

    >>> wave = np.sin(0.7 * np.arange(200.0))
    >>> bool(np.abs(derivatives(wave)[50:150] / 0.7 - np.cos(0.7 * np.arange(50.0, 150.0))).max() < 5e-4)
    True
    """
    reach = min(REACH, len(samples) - 1)
    if reach < 1:
        return np.zeros(len(samples))
    m = np.arange(1, reach + 1)
    weights = -((-1.0) ** m) / m * np.kaiser(2 * reach + 1, SHAPE)[reach + 1 :]
    longer = np.pad(samples, reach, mode="reflect", reflect_type="odd")
    return np.asarray(np.convolve(longer, np.concatenate([weights[::-1], [0.0], -weights]), mode="valid"))


def smooth(samples: Array, at: Array) -> Array:
    """Return a band-limited signal between its samples: the cubics through these with the right derivatives.

    Parameters
    ----------
    samples
        n values.
    at
        Where, in sampling periods from the first sample, from 0 to n - 1.
    """
    first = np.minimum(np.floor(at).astype(np.intp), len(samples) - 2)
    f, slope = at - first, derivatives(samples)
    difference = samples[first + 1] - samples[first]
    bend = (slope[first] - difference) * (1 - f) - (slope[first + 1] - difference) * f
    return np.asarray(samples[first] + difference * f + f * (1 - f) * bend)
