"""Exact steps of linear systems: what an input that is a parabola over the step does to the state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Coefficients of 1, s, s^2 (s: 0 at the start, 1 at the end) of the parabola through start, middle and end.
_PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])


@dataclass(frozen=True)
class Step:
    """How x' = A x + b u passes from the start of a step to some later moment of it.

    Parameters
    ----------
    transition
        State at that moment per state at the start; n x n.
    weights
        State at that moment per input at start, middle and end of the step; n x 3.
    """

    transition: Array
    weights: Array


def step(a: Array, b: Array, length: float, until: float = 1.0) -> Step:
    """Return the exact passage over the fraction `until` of a step, for an input that is a parabola over the whole.

    Parameters
    ----------
    a, b
        System matrix, n x n [1/s], and input vector, n.
    length
        Length of the whole step [s].
    until
        Which part of it is passed over.

    >>> step(np.array([[-2.0]]), np.array([2.0]), 0.5).transition.round(6)
    array([[0.367879]])
    """
    n = len(a)
    h = until * length
    # With the input's monomials as further states, 1 -> s -> s^2, one matrix exponential holds every integral.
    big = np.zeros((n + 3, n + 3))
    big[:n, :n] = h * a
    big[:n, n] = h * b
    big[n, n + 1] = big[n + 1, n + 2] = 1.0
    exponential = _exponential(big)
    # exponential[:n, n + j] is the response to the input sigma^j / j!, with sigma = 1 at the moment looked at.
    to_monomials = np.diag([1.0, until, 2.0 * until**2])
    return Step(exponential[:n, :n], exponential[:n, n:] @ to_monomials @ _PARABOLA)


@njit(cache=True, error_model="numpy")
def _exponential(matrix: Array) -> Array:
    """Return the exponential of a small matrix: Taylor's series of a fraction of it, squared up.

    A fit asks for tens of thousands of them, 5 x 5, where each call of NumPy costs more than the arithmetic.
    """
    norm = np.abs(matrix).sum(axis=1).max()
    halvings = max(0, math.ceil(math.log2(max(norm, 1e-300))) + 1)
    part = matrix / 2.0**halvings
    total = np.eye(len(matrix))
    term = total
    for k in range(1, 16):  # 0.5^16 / 16! is below rounding
        term = _product(term, part) / k
        total = total + term
    for _ in range(halvings):
        total = _product(total, total)
    return total


@njit(cache=True, error_model="numpy")
def _product(a: Array, b: Array) -> Array:
    """Return the product of two square matrices; in loops, as BLAS is for large ones."""
    n = len(a)
    found = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            for j in range(n):
                found[i, j] += a[i, k] * b[k, j]
    return found
