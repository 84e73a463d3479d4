"""Which of the things that vary matters for what: Sobol's indices, by SALib.

Of the variance of a quantity over all cases, the first-order index of a factor is the share that it explains alone, the
total one the share in which it has a part at all; their difference is what it does together with others (Sobol 2001;
Saltelli et al. 2010, Computer Physics Communications 181, 259-270).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexdesign.core import extras
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError


@dataclass(frozen=True)
class Indices:
    """Sobol's indices of one quantity.

    Parameters
    ----------
    first, total
        Of each factor: alone, and together with others.
    first_half, total_half
        Half-widths of their 95 % intervals, by bootstrap.
    """

    first: Array
    total: Array
    first_half: Array
    total_half: Array


def points(dimensions: int, count: int, seed: int) -> Array:
    """Return points of the unit cube from which indices can be found: count x (dimensions + 2) of them.

    `count` is brought up to a power of two, as the balance of the sequence asks.
    """
    from SALib.sample import sobol

    power = 2 ** int(np.ceil(np.log2(max(count, 2))))
    return np.asarray(sobol.sample(_problem(dimensions), power, calc_second_order=False, seed=seed))


def indices(values: Array, dimensions: int, seed: int) -> Indices | None:
    """Return the indices of a quantity at such points; None where it does not vary, or nothing is left of it.

    Points come in groups of dimensions + 2; a group in which one has no value is left out whole.
    """
    from SALib.analyze import sobol

    groups = values.reshape(-1, dimensions + 2)
    whole = groups[np.isfinite(groups).all(axis=1)]
    if len(whole) < 2 or np.ptp(whole) == 0:
        return None
    # SALib takes a seed of zero for none.
    found = sobol.analyze(_problem(dimensions), whole.ravel(), calc_second_order=False, seed=seed + 1)
    return Indices(*(np.asarray(found[name]) for name in ("S1", "ST", "S1_conf", "ST_conf")))


def _problem(dimensions: int) -> Mapping[str, Any]:
    names: Sequence[str] = [str(number) for number in range(dimensions)]
    return {"num_vars": dimensions, "names": names, "bounds": [[0.0, 1.0]] * dimensions}


def refuse_absence(file: object) -> None:
    """Refuse a sample for indices where SALib is not installed.

    Raises
    ------
    InputError
        If it is not.
    """
    try:
        import SALib  # noqa: F401
    except ImportError:
        remedy = extras.requirement("SALib")
        raise InputError(str(file), "sample.method", "sensitivity", remedy) from None
