"""The best linear system of second order between command and reading: what a nonlinear effect must explain more than.

A model may lack linear dynamics that no effect of the catalogue describes: a sensor of velocity or acceleration, parts
that respond at once. Hysteresis then imitates their phase. The reading of the linear system is an amount of the
command, and one each of the position and the velocity of a mode whose frequency and damping are free (output-error
model with three numerator and two denominator coefficients: Ljung, System Identification, 1999, section 4.2). Amounts
are linear and are eliminated (variable projection: Golub and Pereyra 1973).
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.signal_chain import exact_step
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.sparse_residual_model import without_columns
from flexdesign.measurements.recordings import Run

Array = NDArray[np.float64]
#: Damping ratios of the linear system, and the factor by which its frequency may leave where it starts.
DAMPING_RATIOS, LARGEST_FREQUENCY_FACTOR = (1e-3, 3.0), 20.0


def is_better_linear(data: DiagnosisData, base: FittedModel, fit: FittedModel) -> bool:
    """Tell whether the best linear system leaves no more than a fit with nonlinear effects.

    Parameters
    ----------
    data
        What is diagnosed.
    base, fit
        The fit without effects, and one with some of which at least one is nonlinear; else the answer is no.
    """
    if not data.runs or data.responses or all(effects.find(name).is_linear for name in fit.names):
        return False
    model, axis = cast(AxisDynamics, base.model), data.axis
    starts = [(each.natural_frequency, each.damping_ratio) for each in (model.axis, axis)]
    dataset = fit.solution.problem.dataset
    return min(_chi2(dataset, model, *start) for start in starts) <= fit.fitted_chi2


def _chi2(dataset: Dataset, model: AxisDynamics, frequency: float, damping_ratio: float) -> float:
    """Return chi^2 of the linear system that fits a data set best, searched from a frequency and a damping ratio."""
    from scipy.optimize import least_squares

    measured = np.concatenate([dataset.whitened(record, record.measured) for record in dataset.records])

    def residual(logarithms: Array) -> Array:
        columns = np.vstack(
            [
                np.column_stack([dataset.whitened(record, np.where(record.present, column, 0.0)) for column in made])
                for record in dataset.records
                for made in [_columns(model, cast(Run, record.observation), *np.exp(logarithms))]
            ]
        )
        return without_columns(measured, columns)

    start = np.log([frequency, np.clip(damping_ratio, 1.01 * DAMPING_RATIOS[0], 0.99 * DAMPING_RATIOS[1])])
    far = math.log(LARGEST_FREQUENCY_FACTOR)
    bounds = np.array([[start[0] - far, math.log(DAMPING_RATIOS[0])], [start[0] + far, math.log(DAMPING_RATIOS[1])]])
    return float(2 * least_squares(residual, start, bounds=bounds, diff_step=1e-3, max_nfev=40).cost)


def _columns(model: AxisDynamics, run: Run, frequency: float, damping_ratio: float) -> list[Array]:
    """Return the command, and position and velocity of the mode that it drives, from rest at the first sample."""
    command = model.command(run)
    return [command - command[0], *mode_response(command, frequency, damping_ratio, run.period)]


def mode_response(force: Array, frequency: float, damping_ratio: float, period: float) -> tuple[Array, Array]:
    """Return position, and velocity over 2 pi times the frequency, of a mode from rest under a held force.

    Parameters
    ----------
    force
        Over the stiffness, n values; its change from the first one acts.
    frequency, damping_ratio
        Of the mode [Hz, 1].
    period
        Of the samples [s].
    """
    from scipy.signal import lfilter

    w = 2 * math.pi * frequency
    a = w * np.array([[0.0, 1.0], [-1.0, -2 * damping_ratio]])
    passage = exact_step.step(a, w * np.array([0.0, 1.0]), period)
    f, g = passage.transition, passage.weights.sum(axis=1)
    # Each state of x' = F x + g u as a difference equation.
    denominator = [1.0, -np.trace(f), np.linalg.det(f)]
    numerators = ([0.0, g[0], f[0, 1] * g[1] - f[1, 1] * g[0]], [0.0, g[1], f[1, 0] * g[0] - f[0, 0] * g[1]])
    position, velocity = (np.asarray(lfilter(above, denominator, force - force[0])) for above in numerators)
    return position, velocity
