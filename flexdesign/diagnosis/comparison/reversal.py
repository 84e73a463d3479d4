"""Whether a stage moves against its prediction: a common slip is the sign of a gain or of a column."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.measurements.recordings import FrequencyResponse, Run

Array = NDArray[np.float64]
#: Below this correlation the reversed prediction would explain more than half of the motion.
REVERSED_CORRELATION = -math.sqrt(0.5)


def correlation(runs: Iterable[tuple[Array, Array]]) -> float:
    """Return the correlation of measured and predicted motion in all runs together, about the mean of each run.

    Parameters
    ----------
    runs
        Measured and predicted values of each run, n each [response]; NaN where there is no reading.

    Returns
    -------
    float
        From -1 to 1; NaN if nothing moves.

    >>> t = np.linspace(0, 20, 500)
    >>> round(correlation([(np.sin(t), -2 * np.sin(t)), (np.cos(t) + 5, -np.cos(t))]), 3)
    -1.0
    """
    products = np.zeros(3)
    for measured, predicted in runs:
        seen = np.isfinite(measured) & np.isfinite(predicted)
        if seen.any():
            a, b = (values[seen] - values[seen].mean() for values in (measured, predicted))
            products += (a @ b, a @ a, b @ b)
    both, of_measured, of_predicted = products
    return float(both / math.sqrt(of_measured * of_predicted)) if of_measured and of_predicted else math.nan


def question(found: float) -> str:
    """Return what to ask of a stage that moves against its prediction; empty where a correlation shows none."""
    if not found < REVERSED_CORRELATION:
        return ""
    return (
        f"the stage moves against the prediction (correlation {found:.2f}): is the sign of the gain, of the "
        "command or of the response reversed, or the natural frequency wrong about which they are driven"
    )


def doubts(runs: Sequence[Run], residuals: Mapping[str, Array]) -> list[str]:
    """Return the question to ask, or nothing, of runs and their residuals by name [response]."""
    moving = [run for run in runs if run.name in residuals and np.ptp(run.command())]
    doubt = question(correlation((run.measured(), run.measured() - residuals[run.name]) for run in moving))
    return [doubt] if doubt else []


def doubts_of_lines(responses: Sequence[FrequencyResponse], residuals: Mapping[str, Array]) -> list[str]:
    """Return the question to ask, or nothing, of frequency responses and their residuals by name [response/V].

    The correlation is the mean cosine of the phase between measured and predicted lines, whatever their size.
    """
    cosines = list[Array]()
    for each in responses:
        real, imaginary = np.split(each.measured() - residuals[each.name], 2)
        both = each.response * (real - 1j * imaginary)
        both = both[each.present & (both != 0)]
        cosines.append(both.real / np.abs(both))
    doubt = question(float(np.mean(np.concatenate(cosines)))) if cosines else ""
    return [doubt] if doubt else []
