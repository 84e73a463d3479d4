"""A design's compliance model beside a static table: errors, and whether they say anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.static_tables import StaticModel, StaticTable, Uncertainty, uncertainty

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TableComparison:
    """A model beside a table.

    Parameters
    ----------
    model, table
        What was compared.
    predicted
        What the model says of each row, SI.
    uncertainty
        How far it may be off although nothing is missing.
    """

    model: StaticModel
    table: StaticTable
    predicted: Array
    uncertainty: Uncertainty

    @property
    def errors(self) -> Array:
        """Predicted over measured, less one."""
        return np.asarray(self.predicted / self.table.measured() - 1)

    @property
    def significance(self) -> Array:
        """Size of each difference over the validation uncertainty: above one it says that the model is wrong there."""
        return np.asarray(np.abs(self.predicted - self.table.measured()) / self.uncertainty.validation)


def compare(model: StaticModel, table: StaticTable) -> TableComparison:
    """Compare a model with a table.

    Raises
    ------
    InputError
        If the model has no number for a row.
    """
    return TableComparison(model, table, model.predict(table), uncertainty(model, table))
