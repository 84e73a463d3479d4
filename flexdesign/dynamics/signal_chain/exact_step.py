"""Exact steps of linear systems: what an input that is a parabola over the step does to the state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from flexdesign.core.arrays import Array

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
    return Step(*_passage(a, b, length, until))


@njit(cache=True, error_model="numpy")
def half_and_whole(a0: float, a1: float, b0: float, b1: float, length: float) -> Array:
    """Return 16 numbers of p' = q + b0 d, q' = -a0 p - a1 q + b1 d over a step, see `memory_layout.Modes`.

    Parameters
    ----------
    a0, a1, b0, b1
        The coefficients of a part, see `partial_fractions.Part`.
    length
        Length of the step [s].
    """
    # In p and q over w, where the matrix is balanced; then in p and q.
    w = math.sqrt(a0) if a0 > 0.0 else abs(a1)
    a, b = np.array([[0.0, w], [-a0 / w, -a1]]), np.array([b0, b1 / w])
    numbers = np.empty(16)
    for first, until in ((0, 0.5), (6, 1.0)):
        transition, weights = _passage(a, b, length, until)
        for i in range(2):
            size = 1.0 if i == 0 else w
            numbers[first + 2 * i] = size * transition[i, 0]
            numbers[first + 2 * i + 1] = size * transition[i, 1] / w
            if until < 1.0:
                numbers[first + 4 + i] = size * weights[i].sum()
            else:
                numbers[first + 4 + 3 * i : first + 7 + 3 * i] = size * weights[i]
    return numbers


@njit(cache=True, error_model="numpy")
def _passage(a: Array, b: Array, length: float, until: float) -> tuple[Array, Array]:
    """Return transition and weights, see `Step`."""
    n, h = len(a), until * length
    # With the input's monomials as further states, 1 -> s -> s^2, one matrix exponential holds every integral.
    big = np.zeros((n + 3, n + 3))
    big[:n, :n] = h * a
    big[:n, n] = h * b
    big[n, n + 1] = big[n + 1, n + 2] = 1.0
    exponential = _exponential(big)
    # exponential[:n, n + j] is the response to the input sigma^j / j!, with sigma = 1 at the moment looked at.
    weights, to_monomials = np.zeros((n, 3)), (1.0, until, 2.0 * until**2)
    for j in range(3):
        for k in range(3):
            weights[:, k] += exponential[:n, n + j] * (to_monomials[j] * _PARABOLA[j, k])
    return exponential[:n, :n].copy(), weights


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
