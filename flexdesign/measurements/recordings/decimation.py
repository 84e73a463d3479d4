"""Oversampled runs, brought to fewer samples: a low-pass of zero phase before every nth sample is kept.

The low-pass has a finite response, a Kaiser window of twenty periods of the lower rate, so that it delays nothing and
leaves constant values as they are. All columns go through the same one: a linear stage answers a filtered command with
a filtered response. What happens within few samples of the lower rate, such as the edge of a step that meets a
saturation, is smoothed before the stage, where in truth it came after it. Oppenheim and Schafer, Discrete-Time Signal
Processing, sections 4.6 and 7.5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.measurements.recordings.gap_filling import gaps
from flexdesign.measurements.recordings.run import COMMANDS, Between

#: Periods of the lower rate that the low-pass reaches to each side, as that of `scipy.signal.decimate`.
REACH = 10
#: Attenuation [dB], whose inverse is the ripple of what is kept; and the edge (-6 dB) over the Nyquist frequency of the
#: lower rate. A window of this length needs 0.25 to each side: up to 0.5 everything is kept, and nothing folds back.
ATTENUATION, EDGE = 80.0, 0.75


def low_pass(factor: int, *, even: bool = False) -> Array:
    """Return the coefficients of the low-pass, whose sum is one.

    Parameters
    ----------
    factor
        Which sample is kept, 2 or more.
    even
        Whether it has an even number of coefficients, and is symmetric about the middle between two samples.
    """
    from scipy.signal import firwin, kaiser_beta

    window = ("kaiser", kaiser_beta(ATTENUATION))
    return np.asarray(firwin(2 * REACH * factor + (not even), EDGE / factor, window=window))


def noise_gain(factor: int) -> float:
    """Return the standard deviation of white noise behind the low-pass over that before it.

    >>> round(noise_gain(20) * 20**0.5, 2)
    0.84
    """
    return math.sqrt(float(np.sum(low_pass(factor) ** 2)))


def decimate(
    time: Array, columns: Mapping[str, Array], factor: int, between: Between
) -> tuple[Array, dict[str, Array], str]:
    """Return every nth sample behind a low-pass, and a remark.

    The ends, over which the low-pass would reach, are left out. Gaps of readings shorter than a period of the lower
    rate are bridged by straight lines; next to longer ones there is nothing to read as far as the low-pass reaches. A
    command that is held acts half a sample after its numbers.

    Parameters
    ----------
    time
        n moments [s].
    columns
        n values each, in any unit; commands are finite, others may be NaN.
    factor
        Which sample is kept, 2 or more.
    between
        What commands do between the samples that were recorded; afterwards they are ``smooth``.

    Returns
    -------
    tuple
        Fewer moments, fewer values of each column, and what was done, in words.
    """
    from scipy.signal import upfirdn

    reach = REACH * factor
    kept = np.arange(reach, len(time) - reach, factor)
    if not len(kept):
        return time[:0], {name: values[:0] for name, values in columns.items()}, ""
    found = {}
    for name, values in columns.items():
        is_held = name in COMMANDS and between == "hold"
        bridged, missing = _bridge(values, factor)
        weights = low_pass(factor, even=is_held)
        # Full overlap of the filter begins at its last coefficient, and is read at its middle.
        first = 2 * reach - is_held
        filtered = upfirdn(weights, bridged)[first::factor][: len(kept)]
        if missing.any():
            about = np.concatenate([[0], np.cumsum(missing)])
            filtered[about[kept + reach + 1 - is_held] - about[kept - reach] > 0] = np.nan
        found[name] = filtered
    rate = (len(time) - 1) / (time[-1] - time[0])
    remark = (
        f"one sample in {factor} is used, behind a low-pass of zero phase at {0.5 * EDGE * rate / factor:.4g} Hz: "
        f"{len(kept)} of {len(time)}"
    )
    return time[kept], found, remark


def _bridge(values: Array, factor: int) -> tuple[Array, np.ndarray]:
    """Return values without gaps, and which of them are in a gap of `factor` or more."""
    there = np.isfinite(values)
    if there.all():
        return values, np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(there)
    if not len(known):
        return np.zeros(len(values)), ~there
    filled = np.interp(np.arange(len(values)), known, values[known])
    long = np.zeros(len(values), dtype=bool)
    for first, last in gaps(~there):
        long[first:last] = last - first >= factor or first == 0 or last == len(values)
    return filled, long
