"""Which cases a sweep has: every combination of a grid, or a sample that fills the space evenly.

Latin hypercubes (McKay, Beckman and Conover 1979) and scrambled Sobol sequences (Owen 1998) are scipy's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.workflows.sweeps import sensitivity

Method = Literal["grid", "latin-hypercube", "sobol", "sensitivity"]


@dataclass(frozen=True)
class Factor:
    """What varies: a number between two ends, or one of several values.

    Parameters
    ----------
    key
        What it is in the design, as ``--set`` names it: ``dimensions.width``.
    values
        The values of a grid, or all there are: SI numbers, or texts such as a material's name.
    ends
        Ends between which it may have any value [SI]; None for a choice among `values`.
    is_log
        Whether equal ratios count as equal steps.
    si, unit
        Its SI unit and the unit in which it is read; empty where it is no number.
    """

    key: str
    values: tuple[float | str, ...]
    ends: tuple[float, float] | None = None
    is_log: bool = False
    si: str = ""
    unit: str = ""

    @property
    def name(self) -> str:
        """Its key without the table it is in."""
        return self.key.partition(".")[2] or self.key

    @property
    def is_number(self) -> bool:
        """Whether its values are numbers."""
        return bool(self.si)

    def formatted(self, value: float | str, unit: bool = True) -> str:
        """Return one of its values as it is read, with its unit or without."""
        if isinstance(value, str):
            return value
        number = f"{value / units.factor(self.unit or '1', self.si):.5g}"
        return f"{number} {self.unit}" if unit and self.unit not in ("", "1") else number

    def at(self, share: float) -> float | str:
        """Return the value at a share of its range, from 0 to 1; of a choice all values have equal parts of it."""
        if self.ends is None:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        low, high = self.ends
        if self.is_log:
            return math.exp(math.log(low) + share * (math.log(high) - math.log(low)))
        return low + share * (high - low)


@dataclass(frozen=True)
class Case:
    """One version of a design.

    Parameters
    ----------
    values
        What is varied, by key: SI numbers, or texts.
    """

    values: Mapping[str, float | str] = field(default_factory=dict)


def cases(factors: Sequence[Factor], method: Method, count: int, seed: int) -> Iterator[Case]:
    """Yield the cases of a sweep.

    Parameters
    ----------
    factors
        What varies.
    method
        ``grid``: every combination of the factors' values. ``latin-hypercube`` and ``sobol``: `count` points, each
        factor over its whole range. ``sensitivity``: `count` times the number of factors and two, in an order from
        which Sobol's indices follow.
    count, seed
        Number of points, and the seed that draws them.
    """
    keys = [factor.key for factor in factors]
    if method == "grid":
        for values in itertools.product(*(factor.values for factor in factors)):
            yield Case(dict(zip(keys, values, strict=True)))
        return
    for point in _points(len(factors), method, count, seed):
        yield Case({f.key: f.at(float(share)) for f, share in zip(factors, point, strict=True)})


def _points(dimensions: int, method: Method, count: int, seed: int) -> Array:
    from scipy.stats import qmc

    rng = np.random.default_rng(seed)
    if method == "sensitivity":
        return sensitivity.points(dimensions, count, seed)
    if method == "sobol":
        power = math.ceil(math.log2(max(count, 1)))  # the balance of a sequence shows in powers of two
        return np.asarray(qmc.Sobol(dimensions, rng=rng).random_base2(power)[:count])
    return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(count))
