"""How far a prediction may be from a measurement although nothing is missing: the validation uncertainty.

Three parts, as in ASME V&V 20 (2009): of the measurement, u_D; of the inputs, u_input, as parts are made within
tolerances of dimensions and modulus, alike in all rows; and of the model, which is no solution of elasticity, u_model.
A difference says something of the model only where it exceeds U_val, a multiple of the root of the sum of their
squares. As many rows are looked at, the multiple is that of the Bonferroni inequality. Rows that agree one by one may
still differ together, which the sum of squares shows. Comparison and diagnosis both ask `Uncertainty.agrees`.

What the linkage of a part does not state, its model lacks. Without roots the two hundred amplifiers of
`studies.theory_against_fem` are off finite elements by 15 % in K_in, 16 % in K_out and 20 % in K_out with held inputs
(rms). Nearly all of that is what hinges give way at roots of a typical shape
(`hinge_compliance.roots.with_guessed_roots`): with these it is 3.2, 0.5 and 5.5 %, and 2.7 % in lambda. So the
difference between the model with and without a guess is one standard deviation, alike in all rows, and the spread about
the guess is that of a model in which all is stated, times `SPREAD`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc, ndtri

from flexdesign.analytic.static_model.model import StaticModel
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Observation
from flexdesign.measurements.static_table import StaticTable

#: A tolerance says where a number ends, evenly likely between: its standard deviation is this share of it.
EVEN = 1 / math.sqrt(3)
#: Standard deviation of what the compliance model is off by, relative, alike in all rows of a kind: of the amplifiers
#: of `studies.error_bars` against hexahedra, rounded up.
MODEL: Mapping[str, float] = {
    "K_in_output_free": 0.005,
    "K_in_output_held": 0.015,
    "lambda_output_free": 0.004,
    "K_out_input_free": 0.002,
    "K_out_input_held": 0.015,
    "K_out_actuator_installed": 0.012,
    # Of displacements under load: of a parallelogram against a published elastica (tests/analytic/test_large_frame.py).
    "u_x_loaded": 0.01,
    "u_y_loaded": 0.005,
    "theta_z_loaded": 0.02,
    # Of a stage: of the XYZ stage against its condensed finite elements (`flexdesign validate table1`), rounded up.
    "K_in_table_free": 0.01,
    "lambda_table_free": 0.01,
    "K_out_inputs_free": 0.01,
    "K_out_inputs_held": 0.015,
    "K_out_actuators_installed": 0.015,
}
#: Of a measurement without a stated uncertainty: relative.
UNSAID = 0.02
#: How much larger the model error is where a guess replaces what the part does not state: 6.4 times in K_in, 7 in
#: lambda, 2.5 to 3.7 in K_out.
SPREAD = 7.0
#: Of a hundred tables with nothing missing one is said to differ: half of that in single rows, half as a whole.
LEVEL = 0.01


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard deviations of the rows of a table, SI, n each, and how they go together; a `Whitening`.

    Parameters
    ----------
    data, inputs, model
        Of the measurement, of what the part was made like, and of the model.
    covariance
        Of all of them together, n by n.
    unsaid
        Whether some rows state no uncertainty of their own.
    unstated
        Hinges and rods of which the part does not state what they run into, which makes `model` wide.
    """

    data: Array
    inputs: Array
    model: Array
    covariance: Array
    unsaid: bool
    unstated: tuple[str, ...] = ()

    def without(self, row: int) -> Uncertainty:
        """Return the uncertainty of the table without one row."""
        data, inputs, model = (np.delete(part, row) for part in (self.data, self.inputs, self.model))
        covariance = np.delete(np.delete(self.covariance, row, axis=0), row, axis=1)
        return Uncertainty(data, inputs, model, covariance, self.unsaid, self.unstated)

    @cached_property
    def _root(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.covariance))

    @property
    def coverage(self) -> float:
        """Standard deviations that count as a difference, for the number of rows compared."""
        return float(-ndtri(LEVEL / 4 / len(self.data)))  # half of the level, on two sides of each row

    @property
    def validation(self) -> Array:
        """U_val [SI]: what a difference must exceed to say something."""
        return np.asarray(self.coverage * np.sqrt(self.data**2 + self.inputs**2 + self.model**2))

    def squares(self, difference: Array) -> float:
        """Return the sum of squares of differences (n, SI), whitened: about n where nothing is missing."""
        white = np.linalg.solve(self._root, difference)
        return float(white @ white)

    def agrees(self, difference: Array, number: int = 0) -> bool:
        """Tell whether differences (n, SI) are chance, each by itself and all together; `number` numbers are free."""
        free = len(difference) - number
        together = free > 0 and float(chdtrc(free, self.squares(difference))) > LEVEL / 2
        return together and bool((np.abs(difference) <= self.validation).all())

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return residuals (n by k) as independent numbers of variance one."""
        return np.asarray(np.linalg.solve(self._root, residual))


def uncertainty(model: StaticModel, table: StaticTable) -> Uncertainty:
    """Return the uncertainty of a prediction for a table; that of the model is in percent of the measured value.

    Raises
    ------
    InputError
        If the model gives no number for some row.
    """
    predicted = model.predict(table)
    for row, value in zip(table.rows, predicted, strict=True):
        if not math.isfinite(value):
            remedy = f"the model has no finite {row.key} of this part: nothing gives way there in it"
            raise InputError(model.design.file, "part", None, remedy)
    # Relative to what was measured: a model that lacks something may be off by ten times, its uncertainty is not.
    sizes, unstated = np.abs(table.measured()), model.unstated
    data = np.array([row.sigma if row.sigma is not None else UNSAID * abs(row.value) for row in table.rows])
    jacobian = _jacobian(model, table, predicted) * (sizes / np.abs(predicted))[:, None]
    own = np.array([MODEL[row.kind] for row in table.rows]) * sizes * (SPREAD if unstated else 1.0)
    lacking = (replace(model, guessed=True).predict(table) / predicted - 1) * sizes if unstated else np.zeros(len(own))
    kinds = [row.key for row in table.rows]
    alike = np.array([[1.0 if a == b else 0.0 for b in kinds] for a in kinds])
    covariance = np.diag(data**2) + jacobian @ jacobian.T + alike * np.outer(own, own) + np.outer(lacking, lacking)
    unsaid = any(row.sigma is None for row in table.rows)
    inputs = np.sqrt((jacobian**2).sum(axis=1))
    return Uncertainty(data, inputs, np.hypot(own, lacking), covariance, unsaid, unstated)


def _jacobian(model: StaticModel, table: StaticTable, predicted: Array) -> Array:
    """Return how each row changes with each input by one standard deviation: rows by inputs."""
    design, tolerances = model.design, model.design.tolerances
    lengths = [p.name for p in design.part_class.dimensions if p.si == "m"]
    columns = [tolerances.modulus * EVEN * _of_modulus(table, predicted)]
    for name, value in design.dimensions.items():
        if value == 0 or name not in lengths:  # a feature that is not there has no tolerance, nor has a number of parts
            continue
        sigma = tolerances.dimensions * EVEN
        try:
            predictions = [replace(model, made_larger={name: way * sigma}).predict(table) for way in (-1, 1)]
        except InputError:  # at the end of what can be built
            continue
        columns.append((predictions[1] - predictions[0]) / 2)
    return np.column_stack(columns)


def _of_modulus(table: StaticTable, predicted: Array) -> Array:
    """Return the change per relative change of E: stiffnesses go with it, displacements against it, lambda stays."""
    way = [0.0 if row.quantity == "lambda" else -1.0 if row.load else 1.0 for row in table.rows]
    return np.asarray(way * predicted)
