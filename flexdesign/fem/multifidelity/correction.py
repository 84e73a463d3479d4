"""What the planar model leaves out, as a smooth function of the dimensions, learned from a few solids.

With the dimensions x_i that differ between the samples, relative to their geometric mean, and for each quantity q

    ln(q_solid / q_planar) = a_0 + sum_i a_i ln x_i + sum_ij a_ij ln x_i ln x_j:

the width of a leaf relative to its length and thickness, which decides between plane stress and plane strain, changes
stiffnesses by a few percent, and smoothly. The terms are as many as the samples determine with some to spare: with n
dimensions n + 2 samples for the linear ones, (n + 1)(n + 2) for the quadratic ones too; of fewer the mean alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.design.design import Design
from flexdesign.fem.multifidelity import extrusion

FloatArray = NDArray[np.float64]

#: How far beyond the samples, as a share of their range, the correction may be asked.
BEYOND = 0.1


class Evaluator(Protocol):
    """What gives the quantities of a design."""

    def evaluate(self, design: Design) -> list[Quantity]:
        """Return the quantities; raise InputError if the design cannot be built or meshed."""


@dataclass(frozen=True)
class Correction:
    """A fitted correction.

    Parameters
    ----------
    names, centre
        The coordinates that differ between the samples, and their means [SI]: geometric means, with a sign.
    low, high
        Range of the samples in ln(x / centre), shape (n,).
    order
        0, 1 or 2.
    coefficients
        By the quantity's key, in the order of `_terms`.
    errors
        By key the half-width of what the fit leaves, relative: see `fit`.
    """

    names: tuple[str, ...]
    centre: FloatArray
    low: FloatArray
    high: FloatArray
    order: int
    coefficients: Mapping[str, FloatArray]
    errors: Mapping[str, float]

    @classmethod
    def fit(cls, designs: Sequence[Design], planar: Evaluator, solid: Evaluator) -> Correction:
        """Evaluate designs both ways, and fit.

        The error is twice the root mean square over the samples of what a fit without the sample misses it by, which
        with hat matrix H is e_i / (1 - H_ii) (Allen 1974), in quadrature with that of the estimates of the solid. Of
        one sample alone all of the correction is in doubt.

        Raises
        ------
        InputError
            If there is no sample, a sample cannot be evaluated, or a quantity changes its sign between the two.
        """
        if not designs:
            raise InputError("correction", "designs", None, "there are no samples to fit; give at least one design")
        places = [extrusion.coordinates(design) for design in designs]
        names = tuple(name for name in places[0] if len({place[name] for place in places}) > 1)
        table = np.array([[place[name] for name in names] for place in places]).reshape(len(designs), len(names))
        if (np.sign(table) != np.sign(table[0])).any() or (table == 0).any():
            raise InputError("correction", "designs", None, "a dimension changes its sign or is zero among the samples")
        centre = np.sign(table[:1]).reshape(-1) * np.exp(np.log(np.abs(table)).mean(axis=0))
        logs = np.log(table / centre)
        order = next((o for o in (2, 1) if len(designs) >= _samples_needed(len(names), o)), 0)
        terms = _terms(logs, order)
        coefficients, errors = {}, {}
        pairs = [(by_key(planar.evaluate(design)), by_key(solid.evaluate(design))) for design in designs]
        for key in pairs[0][0]:
            ratios = np.array([truth[key].value / flat[key].value for flat, truth in pairs])
            if not (ratios > 0).all():
                raise InputError("correction", key, None, "has another sign in the plane than in space")
            known = np.array([(truth[key].half_width or 0.0) / abs(truth[key].value) for _, truth in pairs])
            coefficients[key] = np.linalg.lstsq(terms, np.log(ratios), rcond=None)[0]
            left = _leave_one_out_error(terms, np.log(ratios), coefficients[key])
            errors[key] = float(np.hypot(2 * left, np.sqrt(np.mean(known**2))))
        return cls(names, centre, logs.min(axis=0), logs.max(axis=0), order, coefficients, errors)

    def apply(self, design: Design, quantities: Sequence[Quantity]) -> list[Quantity]:
        """Correct a design's planar quantities; what the solid samples did not have stays out.

        The estimate grows with the distance outside of the samples, by as much as the whole correction within `BEYOND`
        of their range.
        """
        place = extrusion.coordinates(design)
        logs = np.log(np.array([place[name] for name in self.names]) / self.centre)
        terms = _terms(logs[None], self.order)[0]
        span = np.maximum(self.high - self.low, 1e-12)
        outside = np.maximum(np.maximum(self.low - logs, logs - self.high), 0.0) / span
        beyond = float(outside.max(initial=0.0)) / BEYOND
        corrected = []
        for quantity in quantities:
            if quantity.key not in self.coefficients:
                continue
            change = float(terms @ self.coefficients[quantity.key])
            value = quantity.value * float(np.exp(change))
            error = float(np.hypot(self.errors[quantity.key], beyond * abs(change)))
            source = "planar FEM, corrected to solid FEM"
            corrected.append(replace(quantity, value=value, half_width=error * abs(value), source=source))
        return corrected


def _samples_needed(count: int, order: int) -> int:
    """Return how many samples a fit needs: one more than there are linear terms, twice as many as quadratic ones."""
    return count + 2 if order == 1 else (count + 1) * (count + 2)


def _terms(logs: FloatArray, order: int) -> FloatArray:
    """Return the constant, the logarithms and their products, up to the order, shape (m, terms)."""
    columns = [np.ones(len(logs))]
    if order > 0:
        columns += list(logs.T)
    if order > 1:
        columns += [a * b for a, b in itertools.combinations_with_replacement(logs.T, 2)]
    return np.column_stack(columns)


def _leave_one_out_error(terms: FloatArray, wanted: FloatArray, coefficients: FloatArray) -> float:
    """Return the root mean square of what fits without each sample miss it by."""
    if len(wanted) == 1:
        return abs(float(wanted[0]))  # nothing is known of how it changes: all of the correction is in doubt
    leverage = np.einsum("ij,ji->i", terms, np.linalg.pinv(terms))
    left = (wanted - terms @ coefficients) / np.maximum(1 - leverage, 1e-3)
    return float(np.sqrt(np.mean(left**2)))
